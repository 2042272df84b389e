import assert from "node:assert/strict";
import test from "node:test";
import { Cuts, type Sweep } from "../src/cuts.js";
import { apply, type Affine, type Vec3 } from "../src/geometry.js";
import { Volumes } from "../src/scene.js";

// turned about z, voxels of 0.5 x 0.75 x 1 mm
const [C, S] = [Math.cos(0.3), Math.sin(0.3)];
const GRID: Affine = [[0.5 * C, -0.75 * S, 0, -8], [0.5 * S, 0.75 * C, 0, -9], [0, 0, 1, -6]];
const DIMS: Vec3 = [40, 30, 12];

function volumes(): Volumes {
  // a felt structure, and one that is not felt
  const structure = Uint8Array.from({ length: DIMS[0] * DIMS[1] * DIMS[2] }, (_, n) => (n % 40 < 30 ? 1 : 2));
  return new Volumes("hash", 1, DIMS, GRID, null, structure, 1, 0);
}
const IS_FELT = [false, true, false];
const SWEEPS: Sweep[] = [[-4, -3, -1, -1, -2, 0.5, 2], [-1, -2, 0.5, -1, -2, 0.5, 2], [200, 0, 0, 201, 0, 0, 2], [-9, -9, -6, -8, -9, -6, 1.4]];

/** One voxel after the other, by its distance to places on the way. */
function expected(sweeps: Sweep[]): Uint8Array {
  const { structure } = volumes();
  for (let n = 0; n < structure.length; n++) {
    const at = apply(GRID, [n % 40, Math.floor(n / 40) % 30, Math.floor(n / 1200)]);
    for (const [ax, ay, az, bx, by, bz, radius] of sweeps) {
      if (Math.hypot(at[0] - ax, at[1] - ay, at[2] - az) > radius + Math.hypot(bx - ax, by - ay, bz - az)) continue;
      let least = Infinity;
      for (let part = 0; part <= 1; part += 1 / 4096) least = Math.min(least, Math.hypot(at[0] - ax - part * (bx - ax), at[1] - ay - part * (by - ay), at[2] - az - part * (bz - az)));
      if (structure[n] === 1 && least < radius) structure[n] = 0;
    }
  }
  return structure;
}

test("a felt structure is gone where its voxels' centres were swept", () => {
  const cuts = new Cuts(), its = volumes(), before = its.structure.slice();
  cuts.add(SWEEPS.slice(0, 1));
  assert.ok(cuts.takeFrom(its, IS_FELT));
  assert.deepEqual(its.structure, expected(SWEEPS.slice(0, 1)));
  cuts.add(SWEEPS.slice(1));
  const box = cuts.takeFrom(its, IS_FELT)!;
  assert.deepEqual(its.structure, expected(SWEEPS));
  assert.ok(its.structure.filter((place) => place === 0).length > 100);
  // all that has changed lies in the box that it tells of
  const first = expected(SWEEPS.slice(0, 1));
  for (let n = 0; n < before.length; n++) {
    const at = [n % 40, Math.floor(n / 40) % 30, Math.floor(n / 1200)];
    if (its.structure[n] !== first[n]) assert.ok(at.every((v, axis) => v >= box.lo[axis]! && v < box.lo[axis]! + box.size[axis]!));
  }
  assert.equal(cuts.takeFrom(its, IS_FELT), null, "nothing new");
});

test("another session's cuts begin with what is whole", () => {
  const cuts = new Cuts(), its = volumes(), whole = its.structure.slice();
  cuts.add(SWEEPS);
  cuts.takeFrom(its, IS_FELT);
  cuts.beginAnew();
  assert.ok(cuts.takeFrom(its, IS_FELT));
  assert.deepEqual(its.structure, whole);
  cuts.add(SWEEPS.slice(3));
  cuts.takeFrom(its, IS_FELT);
  assert.deepEqual(its.structure, expected(SWEEPS.slice(3)));
});

test("volumes that come later are cut by all that was told", () => {
  const cuts = new Cuts();
  cuts.add(SWEEPS);
  cuts.takeFrom(volumes(), IS_FELT);
  const others = volumes();
  cuts.takeFrom(others, IS_FELT);
  assert.deepEqual(others.structure, expected(SWEEPS));
});
