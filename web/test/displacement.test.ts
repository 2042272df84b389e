import assert from "node:assert/strict";
import test from "node:test";
import { Displacement, reachOf } from "../src/drawing/displacement.js";
import { aboutAxis, apply, length, rotate, sub, type Affine, type Vec3 } from "../src/base/geometry.js";

const nodeFromPatient: Affine = [
  [0.5, 0, 0, 3],
  [0, 0.5, 0, 2],
  [0, 0, 0.5, 1],
  [0, 0, 0, 1],
];

test("boxes of nodes are written at their position and read back unchanged", () => {
  const displacement = new Displacement({ dims: [4, 3, 5], nodeFromPatient });
  assert.equal(displacement.max_mm, 0);
  const [lo, size]: [Vec3, Vec3] = [
    [1, 0, 2],
    [2, 3, 2],
  ];
  const mm = Array.from({ length: 3 * 12 }, (_, n) => n / 4);
  displacement.write(lo, size, mm);
  assert.deepEqual([...displacement.box(lo, size)], mm);
  assert.deepEqual([...displacement.box([2, 1, 3], [1, 1, 1])], mm.slice(3 * (1 + 2 * (1 + 3)), 3 * (2 + 2 * (1 + 3))));
  assert.deepEqual([...displacement.box([0, 0, 0], [4, 3, 2])], Array(72).fill(0));
  assert.ok(Math.abs(displacement.max_mm - Math.hypot(...mm.slice(-3))) < 1e-5);
  // the maximum is recomputed after a change
  displacement.write(lo, size, Array(36).fill(0));
  assert.equal(displacement.max_mm, 0);
});

test("displacements do not exceed their reported extent along the voxel axes", () => {
  const turned = (v: Vec3) => rotate(aboutAxis([1, 2, 3], 1.1), v);
  const columns = (
    [
      [2, 0, 0],
      [0, 1, 0],
      [0.3, 0, 0.5],
    ] as Vec3[]
  ).map(turned);
  const voxelFromPatient: Affine = [...[0, 1, 2].map((r) => [...columns.map((column) => column[r]!), r]), [0, 0, 0, 1]];
  const reach = reachOf(3, voxelFromPatient);
  let most: Vec3 = [0, 0, 0];
  for (let n = 0; n < 4000; n++) {
    const z = 1 - (2 * n + 1) / 4000;
    const v: Vec3 = [Math.sqrt(1 - z * z) * Math.cos(2.4 * n) * 3, Math.sqrt(1 - z * z) * Math.sin(2.4 * n) * 3, 3 * z];
    assert.ok(Math.abs(length(v) - 3) < 1e-9);
    const by = sub(apply(voxelFromPatient, v), apply(voxelFromPatient, [0, 0, 0])).map(Math.abs) as Vec3;
    assert.ok(by.every((x, axis) => x <= reach[axis]!));
    most = most.map((x, axis) => Math.max(x, by[axis]!)) as Vec3;
  }
  assert.ok(most.every((x, axis) => x > 0.99 * reach[axis]!));
});
