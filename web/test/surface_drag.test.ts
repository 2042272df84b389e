import assert from "node:assert/strict";
import test from "node:test";
import { add, dot, length, normalize, scale, sub, type Vec3 } from "../src/base/geometry.js";
import { Volumes } from "../src/protocol/scene.js";
import { MAX_DISTANCE_MM, type PathPoint } from "../src/state/pointer.js";
import { isHeldBack, SurfaceDrag, type SurfacePoint } from "../src/touch/surface_drag.js";

const SIZE = 80;
const VOXEL_MM = 0.5;
const MIDDLE: Vec3 = [20, 20, 20];

/** A ball of 10 mm, and behind it, 6 mm deeper, a wall that is wider. */
function subject() {
  const voxels = new Uint8Array(SIZE ** 3);
  const isSolid = (p: Vec3) => length(sub(p, MIDDLE)) < 10 || (p[2] < 4 && p[2] > 1);
  for (let n = 0; n < voxels.length; n++) {
    const p = [n % SIZE, Math.floor(n / SIZE) % SIZE, Math.floor(n / SIZE ** 2)].map((i) => VOXEL_MM * i) as Vec3;
    voxels[n] = isSolid(p) ? 1 : 0;
  }
  const patientFromVoxel = [0, 1, 2, 3].map((row) =>
    [0, 1, 2, 3].map((c) => (row === c ? (row < 3 ? VOXEL_MM : 1) : 0)),
  );
  const volumes = new Volumes("", 1, [SIZE, SIZE, SIZE], patientFromVoxel, null, voxels, 1, 0);
  const isTouchable = (p: Vec3) => volumes.structureAt(p) !== null;
  return { volumes, isTouchable };
}
const stroke = (tip: Vec3 = [20, 20, 39]) => {
  const { volumes, isTouchable } = subject();
  return { isTouchable, stroke: new SurfaceDrag(volumes, isTouchable, tip, 0, (_, end) => end) };
};
/** Surface under a cursor that looks down the z axis. */
const under =
  (made: SurfaceDrag, from: Vec3, to: Vec3) =>
  (fraction: number): SurfacePoint | null => {
    const at = add(from, scale(sub(to, from), fraction));
    return made.surfaceAlong({ from: [at[0], at[1], 60], into: [0, 0, -1] });
  };

test("a stroke over a ball follows its surface, and presses along its normal", () => {
  const { stroke: made, isTouchable } = stroke();
  const begun = made.begin(under(made, MIDDLE, MIDDLE));
  assert.ok(begun.slice(0, -1).every(({ at, into }) => into === null && !isTouchable(at)));
  assert.deepEqual(begun.at(-1)!.into !== null, true);
  const steps = made.follow(under(made, MIDDLE, add(MIDDLE, [7, 3, 0])), 100);
  assert.ok(steps.length > 8);
  let before = begun.at(-1)!.at;
  for (const { at, into } of steps) {
    assert.ok(Math.abs(length(sub(at, MIDDLE)) - 10) < VOXEL_MM, "on the surface");
    assert.ok(dot(into!, normalize(sub(MIDDLE, at))) > 0.95, "along the normal");
    assert.ok(length(sub(at, before)) <= 1.5, "without gaps");
    before = at;
  }
});

test("over an edge the tip is lifted, moves where it is free, and is put down on the other side", () => {
  for (const [from, to] of [
    [
      [8, 0, 0],
      [14, 0, 0],
    ],
    [
      [14, 0, 0],
      [8, 0, 0],
    ],
  ] as [Vec3, Vec3][]) {
    const { stroke: made, isTouchable } = stroke();
    const begun = made.begin(under(made, add(MIDDLE, from), add(MIDDLE, from)));
    const steps = made.follow(under(made, add(MIDDLE, from), add(MIDDLE, to)), 60);
    const lifted = steps.filter(({ into }) => into === null);
    assert.ok(lifted.length >= 2, "it is lifted");
    assert.ok(steps.at(-1)!.into !== null && made.point !== null, "it is put down");
    let last: PathPoint = begun.at(-1)!;
    for (const step of steps) {
      const path = sub(step.at, last.at);
      if (length(path) > 1.5) {
        const felt = Array.from({ length: 50 }, (_, n) => isTouchable(add(last.at, scale(path, (n + 1) / 51)))).filter(
          Boolean,
        );
        assert.ok((felt.length / 50) * length(path) < 0.6 + VOXEL_MM, "nothing is passed through");
      }
      last = step;
    }
  }
});

test("without a surface the tip is lifted once, and comes back", () => {
  const { stroke: made } = stroke();
  made.begin(under(made, MIDDLE, MIDDLE));
  const off = made.follow(() => null, 30);
  assert.equal(made.point, null);
  assert.ok(off.length > 0 && off.every(({ into }) => into === null));
  assert.deepEqual(
    made.follow(() => null, 30),
    [],
  );
  const back = made.follow(under(made, MIDDLE, MIDDLE), 30);
  assert.ok(back.at(-1)!.into);
});

test("in a section the outline is pressed along the surface's normal, on the side of the contact", () => {
  const { stroke: made } = stroke();
  const plane = { right: [1, 0, 0] as Vec3, down: [0, 0, 1] as Vec3 };
  // a millimetre inside of the ball, and in its middle
  const edge = made.outlineNear(add(MIDDLE, [9, 0, 0]), plane)!;
  assert.ok(Math.abs(length(sub(edge.at, MIDDLE)) - 10) < VOXEL_MM && dot(edge.into, [-1, 0, 0]) > 0.95);
  // a plane that cuts the ball at an angle: along the plane, a press would slide off
  const oblique = made.outlineNear(add(MIDDLE, [5, 8, 0]), plane)!;
  assert.ok(dot(oblique.into, normalize(sub(MIDDLE, oblique.at))) > 0.95, `${oblique.into} is not the normal`);
  assert.equal(made.outlineNear(MIDDLE, plane), null);
  assert.equal(made.outlineNear(add(MIDDLE, [12, 0, 0]), plane), null);
  // in the middle of the wall, which is 3 mm thick
  for (const side of [4, 1]) {
    const { stroke: one } = stroke();
    one.point = { at: [20, 20, side], into: [0, 0, side === 4 ? -1 : 1], from: [0, 0, -1] };
    const found = one.outlineNear([21, 20, 2.5], plane)!;
    assert.ok(Math.abs(found.at[2] - side) < VOXEL_MM, `${found.at[2]} is not on the side at ${side}`);
  }
});

test("a contact that is held back from the cursor is freed, and one that just follows is not", () => {
  const { stroke: made } = stroke();
  const target = made.begin(under(made, MIDDLE, MIDDLE)).at(-1)!;
  const normal = scale(target.into!, -1);
  const contact = (at: Vec3) => ({ at, normal });
  const away = contact(add(target.at, [MAX_DISTANCE_MM + 1, 0, -1]));
  assert.equal(made.freed(0, target, contact(target.at), target.at), null);
  assert.equal(made.freed(10, target, away, away.at), null);
  assert.equal(made.freed(100, target, away, away.at), null);
  assert.equal(made.freed(120, target, contact(add(target.at, [1, 0, 0])), target.at), null, "it has come");
  assert.equal(made.freed(600, { ...target, into: null }, null, target.at, true), null, "it is lifted anyway");
  const dent = add(target.at, scale(target.into!, 12));
  for (const now_ms of [700, 900])
    assert.equal(made.freed(now_ms, target, contact(dent), dent), null, "soft tissue is dented");
  assert.equal(made.freed(910, target, contact(target.at), target.at), null);
  const side = { at: dent, normal: [1, 0, 0] as Vec3 };
  assert.equal(made.freed(920, target, side, dent), null);
  assert.ok(made.freed(1080, target, side, dent)![0]!.isSetDown, "on a side it has slid off");
  for (const [held, isInside] of [
    [away, false],
    [null, true],
  ] as const) {
    assert.equal(made.freed(1200, target, held, target.at, isInside), null);
    const path = made.freed(1400, target, held, target.at, isInside)!;
    assert.ok(path[0]!.isSetDown && path.at(-1)!.into !== null);
    assert.ok(length(sub(path[0]!.at, target.at)) <= 3 + 1e-9, "it is set down in front of the surface");
    assert.ok(length(sub(path.at(-1)!.at, target.at)) < 1e-9);
  }
  // one that is held back after the tip was lifted
  const lifted = made.follow(() => null, 30).at(-1)!;
  assert.equal(made.freed(2000, lifted, away, away.at), null);
  assert.deepEqual(made.freed(2200, lifted, away, away.at), [{ at: lifted.at, into: null, isSetDown: true }]);
});

test("a contact beside the tip, or on the other side of the structure, is freed within two poses", () => {
  const { stroke: made } = stroke();
  const target = made.begin(under(made, MIDDLE, MIDDLE)).at(-1)!;
  const normal = scale(target.into!, -1);
  const tip = add(target.at, scale(target.into!, 2));
  // held back by a crease 4 mm aside, although the tip has passed; and a dent 9 mm deep, whose contact follows
  assert.ok(isHeldBack(tip, target.into!, add(target.at, [4, 0, 0])));
  assert.ok(!isHeldBack(add(target.at, scale(target.into!, 9)), target.into!, add(target.at, [4, 0, 0])));
  const beside = { at: add(target.at, [4, 0, 0]), normal };
  const behind = { at: add(target.at, scale(target.into!, 1)), normal: target.into! };
  for (const [start_ms, contact, isInside] of [
    [0, beside, false],
    [1000, behind, false],
    [2000, null, true],
  ] as const) {
    assert.equal(made.freed(start_ms, target, contact, tip, isInside), null);
    const path = made.freed(start_ms + 34, target, contact, tip, isInside)!;
    assert.ok(path[0]!.isSetDown && path.at(-1)!.into !== null);
    assert.equal(made.freed(start_ms + 50, target, { at: target.at, normal }, tip), null, "it is there");
  }
});

test("a tip is on its way until its contact is where the cursor shows", () => {
  const { stroke: made } = stroke();
  const target = made.begin(under(made, MIDDLE, MIDDLE)).at(-1)!;
  const normal = scale(target.into!, -1);
  const isTransferring = (contact: { at: Vec3; normal: Vec3 } | null) => {
    made.freed(0, target, contact, target.at);
    return made.isTransferring;
  };
  assert.equal(isTransferring(null), true);
  assert.equal(isTransferring({ at: add(target.at, [MAX_DISTANCE_MM + 0.5, 0, 0]), normal }), true);
  assert.equal(isTransferring({ at: add(target.at, [MAX_DISTANCE_MM - 0.5, 0, 0]), normal }), false);
  // a cursor that has jumped is ahead of the next pose
  made.follow(under(made, MIDDLE, [35, 20, 20]), 1);
  assert.equal(made.isTransferring, true);
  made.follow(() => null, 30);
  assert.equal(isTransferring(null), false, "the cursor is on no surface");
});

test("from one side of a thin structure to the other the tip is lifted", () => {
  const { stroke: made } = stroke();
  const side = (z: number): SurfacePoint => {
    const into: Vec3 = [0, 0, z > 3 ? -1 : 1];
    return { at: [36, 20, z], into, from: into };
  };
  made.begin(() => side(3.9));
  const steps = made.follow((fraction) => side(fraction < 1 ? 3.9 : 2.6), 1);
  assert.ok(steps.some(({ into }) => into === null));
  assert.ok(steps.at(-1)!.into![2] > 0.9);
});

test("a surface that is seen edge-on is followed without lifting the tip", () => {
  const { stroke: made, isTouchable } = stroke();
  const begun = made.begin(under(made, MIDDLE, MIDDLE)).at(-1)!;
  // one pixel further the ray meets the side of the ball, 7 mm below
  const side = add(MIDDLE, [9, 0, 4.3]);
  const pick = (fraction: number) =>
    fraction < 0.9999 ? made.point : made.surfaceAlong({ from: [side[0], side[1], 60], into: [0, 0, -1] });
  const steps = made.follow(pick, 1);
  assert.ok(steps.length > 8 && steps.every(({ into }) => into !== null), "it is not lifted");
  let before = begun.at;
  for (const { at } of steps) {
    assert.ok(Math.abs(length(sub(at, MIDDLE)) - 10) < VOXEL_MM, "on the surface");
    assert.ok(length(sub(at, before)) <= 3, "without gaps");
    before = at;
  }
  // over the edge to the wall behind the ball there is no surface
  const wall = made.surfaceAlong({ from: [34, 20, 60], into: [0, 0, -1] })!;
  assert.ok(!isTouchable(add(wall.at, [0, 0, 1])));
  assert.ok(made.follow((fraction) => (fraction < 0.9999 ? made.point : wall), 1).some(({ into }) => into === null));
});

test("a tool's tip comes to a surface without touching anything else", () => {
  const { volumes, isTouchable } = subject();
  const made = new SurfaceDrag(volumes, isTouchable, [20, 20, 39], 2, (_, end) => end);
  made.begin(under(made, MIDDLE, MIDDLE));
  const steps = made.follow((fraction) => (fraction < 1 ? null : under(made, MIDDLE, [36, 20, 20])(1)), 60);
  const waypoints = steps.filter(({ into }) => into === null);
  assert.ok(waypoints.length >= 2);
  for (const [n, { at, isSetDown }] of waypoints.entries()) {
    const from = waypoints[Math.max(0, n - 1)]!.at;
    if (!isSetDown)
      for (let part = 0; part <= 20; part++)
        assert.ok(length(sub(add(from, scale(sub(at, from), part / 20)), MIDDLE)) > 11.5, "clear of the ball");
  }
});
