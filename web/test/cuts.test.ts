import type { Sweep } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import { Cuts, type VoxelBox } from "../src/state/cuts.js";
import { apply, cross, dot, length, sub, type Affine, type Vec3 } from "../src/base/geometry.js";
import { REMOVED, Volumes } from "../src/protocol/scene.js";

// grid rotated about z by 0.3 rad, with voxels of 0.5 x 0.75 x 1 mm
const [C, S] = [Math.cos(0.3), Math.sin(0.3)];
const GRID: Affine = [
  [0.5 * C, -0.75 * S, 0, -8],
  [0.5 * S, 0.75 * C, 0, -9],
  [0, 0, 1, -6],
];
const DIMS: Vec3 = [40, 30, 12];

function volumes(): Volumes {
  // two structures: 1 with contact forces, 2 without
  const structure = Uint8Array.from({ length: DIMS[0] * DIMS[1] * DIMS[2] }, (_, n) => (n % 40 < 30 ? 1 : 2));
  return new Volumes("hash", 1, DIMS, GRID, null, structure, 1, 0);
}
const IS_FELT = [false, true, false];
const SWEEPS: Sweep[] = [
  [-4, -3, -1, -1, -2, 0.5, 2],
  [-1, -2, 0.5, -1, -2, 0.5, 2],
  [200, 0, 0, 201, 0, 0, 2],
  [-9, -9, -6, -8, -9, -6, 1.4],
  [2, 1, -2, 2.2, 1.1, -2, 1, 3, -1, 2, 1],
  [-5, 4, -1, -5, 4, -1, 0.7, 1, 1, 4, 2.2],
];

/** Maximum of a concave function on [0, 1], by ternary search. */
function greatest(concave: (part: number) => number): number {
  let [lo, hi] = [0, 1];
  for (let n = 0; n < 45; n++) {
    const [a, b] = [lo + (hi - lo) / 3, hi - (hi - lo) / 3];
    if (concave(a) < concave(b)) lo = a;
    else hi = b;
  }
  return Math.max(concave(0), concave(lo), concave(1));
}

/** Penetration depth of a position into a sweep, mm; for cylinders and cones the maximum over balls along the axis. */
function depth(sweep: Sweep, at: Vec3): number {
  const [ax, ay, az, bx, by, bz, radius, ex, ey, ez, last] = sweep;
  if (ex === undefined) return radius - aside(sweep, at);
  // early exit for distant positions
  const reach = Math.hypot(bx - ax, by - ay, bz - az) + Math.hypot(ex, ey!, ez!) + Math.max(radius, last!);
  if (length(sub(at, [ax, ay, az])) > reach) return -1;
  return greatest(
    (t) =>
      radius +
      t * (last! - radius) -
      aside([ax + t * ex, ay + t * ey!, az + t * ez!, bx + t * ex, by + t * ey!, bz + t * ez!, 0], at),
  );
}

/** Distance of a position from a sweep's path, mm: from its ends, or height of the triangle with them. */
function aside([ax, ay, az, bx, by, bz]: Sweep, at: Vec3): number {
  const from: Vec3 = [ax, ay, az],
    to: Vec3 = [bx, by, bz],
    way = sub(to, from);
  if (dot(sub(at, from), way) <= 0) return length(sub(at, from));
  if (dot(sub(at, to), way) >= 0) return length(sub(at, to));
  return length(cross(sub(at, from), way)) / length(way);
}
const voxelOf = (n: number): Vec3 => [n % 40, Math.floor(n / 40) % 30, Math.floor(n / 1200)];
const PLACES = Array.from({ length: DIMS[0] * DIMS[1] * DIMS[2] }, (_, n) => apply(GRID, voxelOf(n)));
const isSwept = (n: number, sweeps: Sweep[]): boolean => sweeps.some((sweep) => depth(sweep, PLACES[n]!) > 0);
const isInside = (n: number, { lo, size }: VoxelBox): boolean =>
  voxelOf(n).every((v, axis) => v >= lo[axis]! && v < lo[axis]! + size[axis]!);

/** Reference: structures after each voxel of an uncut volume is tested against all sweeps. */
const expected = (sweeps: Sweep[], isCut = IS_FELT): Uint8Array =>
  volumes().structure.map((structure, n) => (isCut[structure] && isSwept(n, sweeps) ? 0 : structure));

test("voxels of felt structures are removed where a sweep contains their centres", () => {
  const cuts = new Cuts(),
    its = volumes(),
    before = its.structure.slice();
  cuts.receive(0, SWEEPS.slice(0, 1));
  assert.ok(cuts.applyTo(its, IS_FELT));
  assert.deepEqual(its.structure, expected(SWEEPS.slice(0, 1)));
  cuts.receive(1, SWEEPS.slice(1));
  const box = cuts.applyTo(its, IS_FELT)!;
  assert.deepEqual(its.structure, expected(SWEEPS));
  assert.ok(its.structure.filter((place) => place === 0).length > 100);
  // sections show removed voxels as such
  its.structure.forEach((place, n) => {
    assert.equal(its.removed.has(n), place === 0);
    assert.equal(its.shownAt(n), place === 0 ? REMOVED : place);
  });
  assert.deepEqual(
    its.shownIn([0, 0, 0], its.dims),
    Uint8Array.from(its.structure, (place) => place || REMOVED),
  );
  // the reported box contains all changes
  const first = expected(SWEEPS.slice(0, 1));
  for (let n = 0; n < before.length; n++) {
    if (its.structure[n] !== first[n]) assert.ok(isInside(n, box));
  }
  assert.equal(cuts.applyTo(its, IS_FELT), null, "nothing new");
});

test("another session's cuts start from the intact volume", () => {
  const cuts = new Cuts(),
    its = volumes(),
    whole = its.structure.slice();
  cuts.receive(0, SWEEPS);
  cuts.applyTo(its, IS_FELT);
  cuts.reset();
  assert.ok(cuts.applyTo(its, IS_FELT));
  assert.deepEqual(its.structure, whole);
  assert.equal(its.removed.size, 0);
  cuts.receive(0, SWEEPS.slice(3));
  cuts.applyTo(its, IS_FELT);
  assert.deepEqual(its.structure, expected(SWEEPS.slice(3)));
});

test("volumes that load later receive all earlier cuts", () => {
  const cuts = new Cuts();
  cuts.receive(0, SWEEPS);
  cuts.applyTo(volumes(), IS_FELT);
  const others = volumes();
  cuts.applyTo(others, IS_FELT);
  assert.deepEqual(others.structure, expected(SWEEPS));
});

test("voxels removed by undone sweeps are restored, and no others change", () => {
  let seed = Date.now() & 0x7fffffff;
  const began = seed;
  const random = () => (seed = (Math.imul(seed, 1103515245) + 12345) & 0x7fffffff) / 0x80000000;
  const place = (): Vec3 => apply(GRID, DIMS.map((n) => n * (1.2 * random() - 0.1)) as Vec3);
  // random sweeps: many overlap earlier ones, some contain no voxel
  const sweep = (): Sweep => {
    const at = place();
    const way: Sweep = [
      ...at,
      ...(random() < 0.2 ? at : (at.map((x) => x + 6 * random() - 3) as Vec3)),
      0.4 + 2.5 * random(),
    ];
    // cylinders, and cones short enough for one end to contain the other
    const radius = way[6],
      some = (): number => 4 * random() - 2;
    return random() < 0.6
      ? way
      : [
          ...(way as [number, number, number, number, number, number, number]),
          some(),
          some(),
          some(),
          random() < 0.4 ? radius : 0.4 + 2.5 * random(),
        ];
  };
  const done = { back: 0, gone: 0, kept: 0 };
  for (const isCut of [IS_FELT, [false, false, true], [false, true, true], [false, false, false]]) {
    const cuts = new Cuts();
    let its = volumes(),
      sweeps: Sweep[] = [],
      seen: Uint8Array = its.structure.slice();
    for (let step = 0; step < 12; step++) {
      // one to three messages arrive between updates
      for (let message = Math.floor(3 * random()); message >= 0; message--) {
        const first = random() < 0.4 ? sweeps.length : Math.floor((sweeps.length + 1) * Math.sqrt(random()));
        const more = Array.from({ length: Math.floor(4 * random()) }, sweep);
        cuts.receive(first, more);
        sweeps = [...sweeps.slice(0, first), ...more];
      }
      if (random() < 0.05) {
        its = volumes();
        seen = its.structure.slice();
      }
      const box = cuts.applyTo(its, isCut);
      // reference: remaining sweeps, applied to an uncut volume
      const plain = expected(sweeps, isCut);
      assert.deepEqual(its.structure, plain, `seed ${began}, step ${step}`);
      for (let n = 0; n < plain.length; n++) {
        if (plain[n] === seen[n]) continue;
        assert.ok(box && isInside(n, box), `seed ${began}, step ${step}: voxel ${n} changed outside the box`);
        done[plain[n] === 0 ? "gone" : "back"] += 1;
      }
      done.kept += plain.filter((structure, n) => structure !== 0 && !isCut[structure] && isSwept(n, sweeps)).length;
      seen = plain;
    }
  }
  assert.ok(done.back > 100 && done.gone > 100 && done.kept > 100, `seed ${began}: ${JSON.stringify(done)}`);
});

test("sweeps that follow unknown ones are ignored", () => {
  const cuts = new Cuts(),
    its = volumes();
  cuts.receive(0, SWEEPS.slice(0, 1));
  cuts.applyTo(its, IS_FELT);
  cuts.receive(2, SWEEPS.slice(2));
  assert.equal(cuts.applyTo(its, IS_FELT), null);
  assert.deepEqual(its.structure, expected(SWEEPS.slice(0, 1)));
  cuts.receive(1, SWEEPS.slice(1));
  cuts.applyTo(its, IS_FELT);
  assert.deepEqual(its.structure, expected(SWEEPS));
});
