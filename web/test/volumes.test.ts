import assert from "node:assert/strict";
import test from "node:test";
import { Camera } from "../src/volume/camera.js";
import { BLOCK, Field } from "../src/volume/field.js";
import { aboutAxis, apply, dot, sub, type Affine, type Vec3 } from "../src/base/geometry.js";
import { halfFloats } from "../src/base/half_floats.js";
import { shrinkFor, shrunkGrid, Volumes } from "../src/protocol/scene.js";
import { fromSlider, toSlider } from "../src/panels/structures_panel.js";
import { coarsening, pieceOf, texelsOf } from "../src/volume/texels.js";
import { viewOf } from "../src/volume/view.js";

const grid: Affine = [
  [0.5, 0, 0, -10],
  [0, 0.5, 0, -20],
  [0, 0, 2, 5],
  [0, 0, 0, 1],
];
const mirrored: Affine = [
  [-0.5, 0, 0, -10],
  [0, 0.5, 0, -20],
  [0, 0, 2, 5],
  [0, 0, 0, 1],
];
const worldFromPatient: Affine = [
  [1, 0, 0, 4],
  [0, 0, 1, 5],
  [0, -1, 0, 6],
  [0, 0, 0, 1],
];
const near = (a: readonly number[], b: readonly number[]) =>
  a.forEach((x, i) => assert.ok(Math.abs(x - b[i]!) < 1e-9, `${a} is not ${b}`));

test("a downsampled voxel lies at the centre of those it averages", () => {
  for (const shrink of [2, 4]) {
    const corners = [0, shrink - 1].map((i) => apply(grid, [i, i, i]));
    near(
      apply(shrunkGrid(grid, [shrink, shrink, shrink]), [0, 0, 0]),
      corners[0]!.map((x, axis) => (x + corners[1]![axis]!) / 2),
    );
  }
});

test("a volume is downsampled until it fits the device", () => {
  assert.equal(shrinkFor([256, 256, 124], { maxSide: 2048, maxTexels: 1e7 }), 1);
  assert.equal(shrinkFor([256, 256, 124], { maxSide: 2048, maxTexels: 1e6 * 2 }), 2);
  assert.equal(shrinkFor([256, 256, 124], { maxSide: 2048, maxTexels: 1e5 * 2 }), 4);
  assert.equal(shrinkFor([600, 100, 100], { maxSide: 512, maxTexels: 1e9 }), 2);
});

test("texels are voxels if memory allows, else the finest axis is coarsened first", () => {
  const card = { maxTexels: 64e6, maxSide: 2048 };
  assert.deepEqual(coarsening([100, 100, 100], [1, 1, 1], { maxTexels: 1e6, maxSide: 2048 }), [1, 1, 1]);
  assert.deepEqual(coarsening([200, 200, 200], [1, 1, 1], { maxTexels: 1e6, maxSide: 2048 }), [2, 2, 2]);
  // knee scan: its slices, thicker than pixels, are downsampled last
  assert.deepEqual(coarsening([512, 512, 120], [0.28, 0.28, 1], card), [1, 1, 1]);
  assert.deepEqual(coarsening([512, 512, 120], [0.28, 0.28, 1], { ...card, maxTexels: 9e6 }), [2, 2, 1]);
  assert.deepEqual(coarsening([512, 512, 120], [0.28, 0.28, 1], { ...card, maxTexels: 1.2e6 }), [4, 4, 2]);
  // limit of the texture's side, border included
  assert.deepEqual(coarsening([2046, 64, 64], [1, 1, 1], card), [1, 1, 1]);
  assert.deepEqual(coarsening([64, 2047, 64], [1, 1, 1], card), [1, 2, 1]);
  // an axis of one texel cannot be downsampled
  assert.deepEqual(coarsening([1, 10, 10], [0.1, 1, 1], { ...card, maxTexels: 25 }), [1, 2, 2]);
});

function cube(patientFromVoxel: Affine): Volumes {
  const dims: Vec3 = [12, 12, 12];
  const structure = new Uint8Array(1728);
  const scan = new Int16Array(1728);
  for (let k = 3; k < 9; k++)
    for (let j = 3; j < 9; j++) for (let i = 3; i < 6; i++) structure[i + 12 * (j + 12 * k)] = 2;
  scan[1 + 12 * (2 + 12 * 3)] = 40;
  return new Volumes("h", 1, dims, patientFromVoxel, scan, structure, 2, -7);
}

test("values and structures are sampled at positions in the patient", () => {
  for (const m of [grid, mirrored]) {
    const volumes = cube(m);
    assert.equal(volumes.valueAt(apply(m, [1.4, 2.4, 2.6])), 2 * 40 - 7);
    assert.equal(volumes.valueAt(apply(m, [2, 2, 3])), -7);
    assert.equal(volumes.structureAt(apply(m, [4, 4, 4])), 1);
    assert.equal(volumes.structureAt(apply(m, [7, 4, 4])), null);
    assert.equal(volumes.valueAt(apply(m, [-0.6, 0, 0])), null);
    assert.equal(volumes.structureAt(apply(m, [0, 0, 11.6])), null);
  }
});

/** Field of a whole volume, computed in pieces of some slices. */
function fieldOf(
  volumes: { dims: Vec3; structure: Uint8Array; scan: Int16Array | null },
  factor: Vec3,
  slices = 5,
): Field {
  const field = new Field(volumes.dims, factor, volumes.scan !== null);
  for (let z = 0; z < field.dims[2]; z += slices) {
    field.put(pieceOf(volumes, factor, [0, 0, z], [field.dims[0], field.dims[1], Math.min(slices, field.dims[2] - z)]));
  }
  return field;
}
/** Reference: shares of structures in one texel, by the weight of every voxel. */
function sharesBySums(dims: Vec3, structure: Uint8Array, factor: Vec3, place: Vec3): Map<number, number> {
  const count = dims.map((n, axis) => Math.ceil(n / factor[axis]!));
  const fractions = new Map<number, number>();
  for (let n = 0; n < 27; n++) {
    const step = [n % 3, Math.floor(n / 3) % 3, Math.floor(n / 9)].map((x) => x - 1);
    const weight = step.reduce((product, x) => product * (x === 0 ? 0.5 : 0.25), 1);
    const texel = place.map((x, axis) => Math.min(count[axis]! - 1, Math.max(0, x + step[axis]!)));
    const inside: number[] = [];
    for (let c = 0; c < factor[0] * factor[1] * factor[2]; c++) {
      const v = [c % factor[0], Math.floor(c / factor[0]) % factor[1], Math.floor(c / factor[0] / factor[1])].map(
        (x, axis) => texel[axis]! * factor[axis]! + x,
      );
      if (v.every((x, axis) => x < dims[axis]!)) inside.push(structure[v[0]! + dims[0] * (v[1]! + dims[1] * v[2]!)]!);
    }
    for (const one of inside) fractions.set(one, (fractions.get(one) ?? 0) + weight / inside.length);
  }
  return fractions;
}
const FACTORS: Vec3[] = [
  [1, 1, 1],
  [2, 2, 2],
  [3, 3, 3],
  [2, 3, 1],
];
function randomVolume(dims: Vec3, structures: number): { dims: Vec3; structure: Uint8Array; scan: Int16Array } {
  let seed = 7;
  const random = () => (seed = (Math.imul(seed, 1103515245) + 12345) & 0x7fffffff) / 0x80000000;
  const voxels = dims[0] * dims[1] * dims[2];
  const structure = new Uint8Array(voxels);
  // random boxes, which have both borders and uniform regions
  for (let n = 0; n < 14; n++) {
    const lo = dims.map((d) => Math.floor(random() * d)),
      hi = dims.map((d) => Math.floor(random() * d));
    for (let at = 0; at < voxels; at++) {
      const v = [at % dims[0], Math.floor(at / dims[0]) % dims[1], Math.floor(at / dims[0] / dims[1])];
      if (v.every((x, axis) => x >= Math.min(lo[axis]!, hi[axis]!) && x <= Math.max(lo[axis]!, hi[axis]!)))
        structure[at] = n % (structures + 1);
    }
  }
  return { dims, structure, scan: Int16Array.from({ length: voxels }, () => Math.floor(2000 * random() - 1000)) };
}

test("texels equal direct sums over their neighbourhoods, in pieces, too", () => {
  const volume = randomVolume([13, 11, 9], 3);
  for (const factor of FACTORS) {
    const field = fieldOf(volume, factor, 2);
    for (let z = 0; z < field.dims[2]; z++)
      for (let y = 0; y < field.dims[1]; y++)
        for (let x = 0; x < field.dims[0]; x++) {
          const [first, second, own, other] = field.texels.subarray(field.at(x, y, z), field.at(x, y, z) + 4);
          const fractions = sharesBySums(volume.dims, volume.structure, factor, [x, y, z]);
          const covered = 1 - (fractions.get(0) ?? 0);
          assert.ok(Math.abs((own! + other!) / 255 - covered) < 0.0021, `coverage at ${[x, y, z]} of factor ${factor}`);
          const most = [...fractions].filter(([structure]) => structure > 0).sort((a, b) => b[1] - a[1]);
          if (most.length === 1) assert.deepEqual([first, own! > 0 || covered < 0.002], [most[0]![0], true]);
          // shares of two structures are exact; with more, the two largest ones absorb the others
          if (most.length === 2) {
            for (const [structure, share] of most) {
              const stored = (structure === first ? own! : 0) + (structure === second ? other! : 0);
              assert.ok(Math.abs(stored / 255 - share) < 0.005, `${structure} at ${[x, y, z]} of factor ${factor}`);
            }
          }
        }
    // empty border
    assert.ok(field.texels.subarray(0, 4 * field.bordered[0] * field.bordered[1]).every((byte) => byte === 0));
  }
});

test("only a changed box is recomputed", () => {
  for (const factor of FACTORS) {
    const volume = randomVolume([17, 14, 11], 3);
    const field = fieldOf(volume, factor);
    const [lo, size]: [Vec3, Vec3] = [
      [5, 3, 4],
      [4, 5, 3],
    ];
    for (let k = 0; k < size[2]; k++)
      for (let j = 0; j < size[1]; j++)
        for (let i = 0; i < size[0]; i++) {
          volume.structure[lo[0] + i + volume.dims[0] * (lo[1] + j + volume.dims[1] * (lo[2] + k))] = 9;
        }
    const box = texelsOf(lo, size, volume.dims, factor);
    field.put(pieceOf(volume, factor, box.lo, box.size));
    assert.deepEqual(field.texels, fieldOf(volume, factor).texels);
    const shown = new Array(256).fill(true);
    assert.deepEqual(field.skips(shown), fieldOf(volume, factor).skips(shown));
  }
});

test("a ray's leap ends before the next block with visible structures", () => {
  const dims: Vec3 = [80, 50, 40];
  const structure = new Uint8Array(80 * 50 * 40);
  structure[3 + 80 * (3 + 50 * 3)] = 1;
  structure[70 + 80 * (44 + 50 * 30)] = 2;
  const field = fieldOf({ dims, structure, scan: null }, [1, 1, 1], 16);
  for (const shown of [
    [0, 1, 1],
    [0, 0, 1],
    [0, 0, 0],
  ]) {
    const skips = field.skips(shown);
    const full = [
      [3, 3, 3, 1],
      [70, 44, 30, 2],
    ]
      .filter(([, , , place]) => shown[place!])
      .map((p) => p.slice(0, 3).map((x) => Math.floor(x / BLOCK)));
    skips.forEach((skip, n) => {
      const block = [
        n % field.blocks[0],
        Math.floor(n / field.blocks[0]) % field.blocks[1],
        Math.floor(n / field.blocks[0] / field.blocks[1]),
      ];
      const expected = Math.min(
        255,
        ...full.map((other) => Math.max(...other.map((x, axis) => Math.abs(x - block[axis]!)))),
      );
      assert.equal(skip, expected, `block ${block}`);
    });
  }
});

test("the coverage of texels follows the opacities of their structures", () => {
  const volume = randomVolume([13, 11, 9], 5);
  const appearances = Uint8Array.from({ length: 1024 }, (_, n) =>
    n % 4 < 3 ? n & 255 : ([0, 255, 128, 255, 0, 1][n >> 2] ?? 0),
  );
  for (const factor of FACTORS) {
    const field = fieldOf(volume, factor);
    const [lo, size]: [Vec3, Vec3] = [[1, 2, 0], field.dims.map((n, axis) => n - [1, 2, 0][axis]!) as Vec3];
    const covers = field.covers(lo, size, appearances);
    assert.equal(covers.length, 2 * size[0] * size[1] * size[2]);
    for (let z = 0, n = 0; z < size[2]; z++)
      for (let y = 0; y < size[1]; y++)
        for (let x = 0; x < size[0]; x++, n += 2) {
          const at = field.at(lo[0] + x, lo[1] + y, lo[2] + z);
          const sums = [0, 0];
          for (const c of [0, 1]) {
            const opacity = appearances[4 * field.texels[at + c]! + 3]!;
            if (opacity > 0) sums[opacity === 255 ? 0 : 1]! += field.texels[at + 2 + c]!;
          }
          assert.deepEqual([...covers.subarray(n, n + 2)], sums, `at ${[x, y, z]} of factor ${factor}`);
        }
  }
});

test("the scan around structures is the mean over a texel", () => {
  const volume = randomVolume([7, 5, 4], 1);
  const field = fieldOf(volume, [3, 3, 3], 1);
  let sum = 0;
  for (let k = 3; k < 4; k++)
    for (let j = 3; j < 5; j++) for (let i = 0; i < 3; i++) sum += volume.scan[i + 7 * (j + 5 * k)]!;
  assert.equal(field.haze![0 + 3 * (1 + 2 * 1)], Math.round(sum / 6));
  assert.deepEqual(fieldOf(volume, [1, 1, 1]).haze, volume.scan);
});

test("half floats are the values to eleven bits", () => {
  const values = Int16Array.from([0, 1, -1, 2047, -2048, 2049, 32767, -32768, 12345, -1024]);
  const back = [...halfFloats(values)].map((bits) => {
    const [exponent, mantissa] = [(bits >> 10) & 31, bits & 1023];
    return bits === 0 ? 0 : (bits & 0x8000 ? -1 : 1) * 2 ** (exponent - 15) * (1 + mantissa / 1024);
  });
  values.forEach((value, n) =>
    assert.ok(Math.abs(back[n]! - value) <= Math.abs(value) / 2048, `${value} became ${back[n]}`),
  );
});

test("values written into a volume are read back, and all rays of its picture hit it", () => {
  for (const m of [grid, mirrored]) {
    const volumes = cube(m);
    volumes.write([7, 8, 9], [2, 1, 2], new Uint8Array([1, 2, 2, 1]));
    assert.equal(volumes.structureAt(apply(m, [7, 8, 9])), 0);
    assert.equal(volumes.structureAt(apply(m, [8, 8, 9])), 1);
    assert.equal(volumes.structureAt(apply(m, [8, 8, 10])), 0);
    const camera = new Camera();
    camera.setWorldFromPatient(worldFromPatient);
    camera.orbit(30, 50);
    camera.focus = camera.toWorld(volumes.centre);
    const view = viewOf(camera, 200, 100, 2);
    assert.deepEqual([view.width, view.height], [100, 50]);
    const middle = [0, 1, 2].map((i) => view.corner[i]! + 50 * view.across[i]! + 25 * view.down[i]!) as Vec3;
    near(middle, volumes.centre);
    assert.ok(Math.abs(Math.hypot(...view.across) - 2 * camera.mmPerPixel) < 1e-9);
    near(
      camera.project(
        [0, 1, 2].map((i) => middle[i]! + 10 * view.across[i]! + 4 * view.down[i]! + 30 * view.into[i]!) as Vec3,
      ),
      [20, 8],
    );
  }
});

test("in the anterior view, the patient's left is on image right and the head on top", () => {
  const camera = new Camera();
  camera.setWorldFromPatient(worldFromPatient);
  for (const rotation of [[1, 0, 0, 0], aboutAxis([1, 2, 3], 1.1)] as const) {
    camera.setRotation([...rotation] as [number, number, number, number]);
    camera.orient("anterior");
    const origin = camera.project([0, 0, 0]);
    const [left, up, front] = [
      [1, 0, 0],
      [0, 0, 1],
      [0, -1, 0],
    ].map((p) => sub([...camera.project(p as Vec3), 0], [...origin, 0]));
    assert.ok(left![0]! > 0 && Math.abs(left![1]!) < 1e-9);
    assert.ok(up![1]! < 0 && Math.abs(up![0]!) < 1e-9);
    assert.ok(Math.hypot(...front!) < 1e-9);
    assert.ok(dot(camera.directionToPatient(camera.backward()), [0, -1, 0]) > 0.999999, "the viewer is in front");
  }
});

test("a point of the picture is unprojected to the patient", () => {
  const camera = new Camera();
  camera.setWorldFromPatient(worldFromPatient);
  camera.setRotation(aboutAxis([3, -1, 2], 0.8));
  camera.orbit(40, -70);
  const p: Vec3 = [12, -7, 31];
  near(camera.unproject(...camera.project(p), p), p);
});

test("dragging to the right moves the front to the right", () => {
  const camera = new Camera();
  camera.setWorldFromPatient(worldFromPatient);
  camera.orient("anterior");
  const front = apply(worldFromPatient, [0, -50, 0]);
  const [x] = camera.project([0, -50, 0]);
  camera.setRotation(camera.dragged(30, 0));
  assert.ok(camera.project([0, -50, 0])[0] > x, `${front}`);
});

test("a stiffness slider is logarithmic and invertible", () => {
  const limits: [number, number] = [0.01, 10];
  assert.equal(toSlider(0.01, limits), 0);
  assert.equal(toSlider(10, limits), 1);
  assert.ok(Math.abs(toSlider(1, limits) - 2 / 3) < 1e-12);
  for (const value of [0.02, 0.35, 1.1, 9]) assert.equal(fromSlider(toSlider(value, limits), limits), value);
});
