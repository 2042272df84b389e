import assert from "node:assert/strict";
import test from "node:test";
import { aboutAxis, apply, invert, length, rotate, sub, type Vec3 } from "../src/base/geometry.js";
import { WireError, WireVersion } from "../src/protocol/wire.js";
import { decodeDeformation, isDeformation } from "../src/protocol/deformation_message.js";
import { Deformation } from "../src/state/deformation.js";

const turned = (
  [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ] as Vec3[]
).map((v) => rotate(aboutAxis([1, 2, 3], 0.7), v));

/**
 * Encoded message, by the table of docs/reference/viewer-messages.md.
 * @param moved  displacement of each node, mm
 */
function written(
  moved: (i: number, j: number, k: number) => Vec3,
  {
    dims = [12, 10, 9] as Vec3,
    lo = [1, 2, 1] as Vec3,
    size = [4, 3, 5] as Vec3,
    first = [-10, 5, 7.5] as Vec3,
    device = 0,
    step = 0.001,
    axes = turned,
  } = {},
): DataView {
  const bytes = 96 + 6 * size[0] * size[1] * size[2];
  const view = new DataView(new ArrayBuffer(bytes));
  "PLPY".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, 3, true);
  view.setUint16(6, device, true);
  view.setUint32(8, bytes, true);
  view.setUint32(12, 77, true);
  [...dims, ...lo, ...size].forEach((count, n) => view.setUint16(16 + 2 * n, count, true));
  [...first, ...axes.flat(), 2.5, step].forEach((x, n) => view.setFloat32(36 + 4 * n, x, true));
  let at = 96;
  for (let k = 0; k < size[2]; k++)
    for (let j = 0; j < size[1]; j++)
      for (let i = 0; i < size[0]; i++) {
        for (const mm of moved(lo[0] + i, lo[1] + j, lo[2] + k)) {
          view.setInt16(at, Math.round(mm / step), true);
          at += 2;
        }
      }
  return view;
}
const rest = (device: number) => written(() => [0, 0, 0], { dims: [0, 0, 0], lo: [0, 0, 0], size: [0, 0, 0], device });
const decoded = (view: DataView) => decodeDeformation(view.buffer as ArrayBuffer);

test("deformation is decoded as specified by the protocol", () => {
  const moved = (i: number, j: number, k: number): Vec3 => [0.1 * i, -0.2 * j, k];
  const { device, frame, nodes, moved_mm } = decoded(written(moved, { device: 2 }));
  assert.deepEqual([device, frame, nodes!.dims], [2, 77, [12, 10, 9]]);
  for (const node of [
    [0, 0, 0],
    [5, 1, 3],
  ] as Vec3[]) {
    const p = turned.reduce((sum, axis, n) => sum.map((x, c) => x + 2.5 * node[n]! * axis[c]!) as Vec3, [
      -10, 5, 7.5,
    ] as Vec3);
    assert.ok(length(sub(apply(nodes!.nodeFromPatient, p), node)) < 1e-5);
  }
  for (let k = 0, n = 0; k < 9; k++)
    for (let j = 0; j < 10; j++)
      for (let i = 0; i < 12; i++, n += 3) {
        const isIn = i >= 1 && i < 5 && j >= 2 && j < 5 && k >= 1 && k < 6;
        const expected = isIn ? moved(i, j, k) : [0, 0, 0];
        for (let c = 0; c < 3; c++) assert.ok(Math.abs(moved_mm[n + c]! - expected[c]!) < 6e-4);
      }
  assert.equal(decoded(rest(1)).nodes, null);
  assert.ok(
    isDeformation(rest(1).buffer as ArrayBuffer) &&
      !isDeformation(new ArrayBuffer(392)) &&
      !isDeformation(new ArrayBuffer(2)),
  );
});

test("anything but a complete deformation message is refused", () => {
  const refused = (change: (view: DataView) => void) => {
    const view = written(() => [1, 1, 1]);
    change(view);
    assert.throws(() => decoded(view), WireError);
  };
  refused((view) => view.setUint8(3, 0x54));
  refused((view) => view.setUint16(6, 4, true)); // device number beyond the maximum
  refused((view) => view.setUint32(8, 95, true)); // size other than the message's
  refused((view) => view.setUint16(16, 65, true)); // more nodes along an axis than the maximum
  refused((view) => view.setUint16(16, 1, true));
  refused((view) => [0, 2, 4].forEach((at) => view.setUint16(16 + at, 64, true)));
  refused((view) => view.setUint16(22, 9, true)); // box outside of the grid
  refused((view) => view.setUint16(28, 65535, true)); // box larger than the message
  refused((view) => view.setUint16(28, 0, true));
  for (const at of [36, 48, 64, 84, 88])
    for (const x of [NaN, Infinity, -1e30]) refused((view) => view.setFloat32(at, x, true));
  refused((view) => view.setFloat32(48, 0.5, true)); // axis that is not a unit vector
  refused((view) => view.setFloat32(84, 0, true));
  refused((view) => view.setFloat32(88, 0, true));
  const other = written(() => [1, 1, 1]);
  other.setUint16(4, 4, true);
  assert.throws(() => decoded(other), WireVersion);
  const whole = written(() => [1, 1, 1]).buffer as ArrayBuffer;
  for (let bytes = 0; bytes < whole.byteLength; bytes++)
    assert.throws(() => decodeDeformation(whole.slice(0, bytes)), WireError);
  assert.throws(() => decodeDeformation(new ArrayBuffer(whole.byteLength + 1)), WireError);
});

test("random deformation messages are refused or give a field without gaps", () => {
  let seed = Date.now() & 0x7fffffff;
  const began = seed;
  const random = () => (seed = (seed * 1103515245 + 12345) & 0x7fffffff) >> 8;
  for (let n = 0; n < 3000; n++) {
    const view = written(() => [0.5, 0, 0.25]);
    for (let flips = 0; flips < 1 + (n % 4); flips++)
      view.setUint8(random() % (n % 2 === 0 ? 96 : view.byteLength), random() & 0xff);
    let received;
    try {
      received = decoded(view);
    } catch (error) {
      assert.ok(error instanceof WireError, `seed ${began}: ${error}`);
      continue;
    }
    if (n % 100 !== 1) continue;
    const deformations = new Deformation();
    deformations.receive(received);
    assert.ok(deformations.displaced(() => false)!.mm.every(Number.isFinite), `seed ${began}`);
  }
});

/** Displacement of a node by a bump that vanishes within the grid. */
const bump = (node: Vec3, middle: Vec3, mm: Vec3): Vec3 =>
  mm.map((x) => x * Math.exp(-(length(sub(node, middle)) ** 2) / 4)) as Vec3;

test("pictures look up rest positions, and tissue that is no longer reported is undeformed", () => {
  const deformations = new Deformation();
  const mm: Vec3 = [1.2, -0.8, 0.9];
  deformations.receive(decoded(written((...node) => bump(node, [5, 5, 4], mm), { lo: [0, 0, 0], size: [12, 10, 9] })));
  const { nodes, mm: back } = deformations.displaced(() => false)!;
  assert.deepEqual(nodes.dims, [18, 16, 15], "as many more on each side as it takes to be at rest");
  const patientFromNode = invert(nodes.nodeFromPatient);
  const received = decoded(written(() => [0, 0, 0])).nodes!;
  // forward displacement by trilinear interpolation of the same nodes
  const forward = (p: Vec3): Vec3 => {
    const node = apply(received.nodeFromPatient, p);
    const low = node.map((x, axis) => Math.min(Math.max(Math.floor(x), 0), received.dims[axis]! - 2)) as Vec3;
    return Array.from({ length: 8 }, (_, c) => [c & 1, (c >> 1) & 1, c >> 2] as Vec3).reduce(
      (sum, corner) => {
        const weight = corner.reduce(
          (product, o, axis) => product * (o ? node[axis]! - low[axis]! : 1 - node[axis]! + low[axis]!),
          1,
        );
        return sum.map(
          (x, c) => x + weight * bump(low.map((l, axis) => l + corner[axis]!) as Vec3, [5, 5, 4], mm)[c]!,
        ) as Vec3;
      },
      [0, 0, 0] as Vec3,
    );
  };
  for (let k = 4, most = 0; k < 11; k++)
    for (let j = 4; j < 12; j++)
      for (let i = 4; i < 14; i++) {
        const seen = apply(patientFromNode, [i, j, k]);
        const n = 4 * (i + 18 * (j + 16 * k));
        const from = seen.map((x, c) => x + back[n + c]!) as Vec3;
        assert.ok(length(sub(from.map((x, c) => x + forward(from)[c]!) as Vec3, seen)) < 0.01);
        assert.ok(
          length(sub(deformations.displacementAt(from), forward(from))) < 1e-3,
          "a tool there is drawn with the tissue",
        );
        assert.equal(back[n + 3], 1);
        most = Math.max(most, length([back[n]!, back[n + 1]!, back[n + 2]!]));
        if (k === 10 && j === 11 && i === 13) assert.ok(most > 1.2);
      }
  assert.equal(back[3], 0, "beyond what is told nothing is known of strain");
  assert.ok([...back.subarray(0, 3)].every((x) => Math.abs(x) < 1e-3));
  // a grid at another position has the same size
  deformations.receive(
    decoded(written((...node) => bump(node, [5, 5, 4], mm), { lo: [0, 0, 0], size: [12, 10, 9], first: [0, 1, 2] })),
  );
  assert.deepEqual(deformations.displaced(() => false)!.nodes.dims, [18, 16, 15]);
  // a tool moves with the displayed tissue, not with reports that are not displayed yet
  const place = turned.reduce((sum, axis, n) => sum.map((x, c) => x + 2.5 * [5, 5, 4][n]! * axis[c]!) as Vec3, [
    0, 1, 2,
  ] as Vec3);
  const drawn = deformations.displacementAt(place);
  assert.ok(length(sub(drawn, mm)) < 1e-3, "at the top of the bump");
  deformations.receive(decoded(rest(0)));
  assert.deepEqual(deformations.displacementAt(place), drawn);
  assert.equal(
    deformations.displaced(() => false),
    null,
  );
  assert.deepEqual(deformations.displacementAt(place), [0, 0, 0]);
});

test("deformations by two devices share a grid and add up", () => {
  const deformations = new Deformation();
  const received = (device: number, first: Vec3, mm: Vec3) =>
    deformations.receive(
      decoded(written((...node) => bump(node, [5, 5, 4], mm), { lo: [0, 0, 0], size: [12, 10, 9], first, device })),
    );
  received(0, [0, 0, 0], [1, 0, 0]);
  received(1, turned[0]!.map((x) => 10 * x) as Vec3, [0, 0.5, 0]);
  const at = (node: Vec3): Vec3 => {
    const { nodes, mm } = deformations.displaced(() => false)!;
    const p = turned.reduce((sum, axis, n) => sum.map((x, c) => x + 2.5 * node[n]! * axis[c]!) as Vec3, [
      0, 0, 0,
    ] as Vec3);
    const [i, j, k] = apply(nodes.nodeFromPatient, p).map(Math.round) as Vec3;
    const n = 4 * (i + nodes.dims[0] * (j + nodes.dims[1] * k));
    return [mm[n]!, mm[n + 1]!, mm[n + 2]!];
  };
  const [one, other, between] = [at([5, 5, 4]), at([9, 5, 4]), at([7, 5, 4])];
  assert.ok(
    one[0] < -0.8 && other[1] < -0.45 && between[0] < -0.2 && between[1] < -0.1,
    JSON.stringify([one, other, between]),
  );
  // devices so far apart that the grid is coarser
  received(1, [600, 0, 0], [0, 0.5, 0]);
  const { nodes } = deformations.displaced(() => false)!;
  assert.ok(nodes.dims.reduce((a, b) => a * b) <= 40_000);
  deformations.forget();
  assert.equal(
    deformations.displaced(() => false),
    null,
  );
});

test("positions next to moving tissue move along in empty space and stay inside structures", () => {
  const deformations = new Deformation();
  const straight: Vec3[] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  // tissue moves at nodes k < 4
  deformations.receive(
    decoded(
      written((_i, _j, k) => (k <= 3 ? [0, 0, -1.5] : [0, 0, 0]), {
        lo: [0, 0, 0],
        size: [12, 10, 9],
        first: [0, 0, 0],
        axes: straight,
      }),
    ),
  );
  const alongZ = (isEmptyAt: (p: Vec3) => boolean) => {
    const { nodes, mm } = deformations.displaced(isEmptyAt)!;
    return Array.from({ length: 9 }, (_, k) => {
      const [i, j, n] = apply(nodes.nodeFromPatient, [15, 12.5, 2.5 * k]).map(Math.round) as Vec3;
      return mm[4 * (i + nodes.dims[0] * (j + nodes.dims[1] * n)) + 2]!;
    });
  };
  const beside = alongZ((p) => p[2] > 9);
  assert.ok(Math.abs(beside[3]! - 1.5) < 0.01, "as far as the tissue below it");
  assert.ok(beside[4]! > 1.2 && beside[6]! < beside[5]! && beside[8]! === 0, JSON.stringify(beside));
  const held = alongZ(() => false);
  assert.ok(held[4]! === 0 && held[3]! > 0.4, JSON.stringify(held));
});
