import assert from "node:assert/strict";
import test from "node:test";
import type { Affine, Vec3 } from "../src/base/geometry.js";
import { Volumes } from "../src/protocol/scene.js";
import { samplesThrough } from "../src/section/slicer.js";
import { sliceAt, slicesAlong } from "../src/section/slices.js";

const volume = (dims: Vec3, X: Affine): Volumes =>
  new Volumes("h", 1, dims, X, null, new Uint8Array(dims[0] * dims[1] * dims[2]), 1, 0);

test("a plane aligned with the grid has the grid's slices, from either side", () => {
  // j from superior to inferior in steps of 2 mm, k to the right in steps of 0.5 mm
  const volumes = volume(
    [10, 20, 30],
    [
      [0, 0, -0.5, 7],
      [1, 0, 0, 0],
      [0, -2, 0, 40],
      [0, 0, 0, 1],
    ],
  );
  assert.deepEqual(slicesAlong(volumes, [0, 0, 1]), { first_mm: 2, step_mm: 2, count: 20 });
  assert.deepEqual(slicesAlong(volumes, [0, 0, -1]), { first_mm: -40, step_mm: 2, count: 20 });
  assert.deepEqual(slicesAlong(volumes, [1, 0, 0]), { first_mm: -7.5, step_mm: 0.5, count: 30 });
  const along = slicesAlong(volumes, [0, 0, 1]);
  assert.deepEqual(
    [2, 2.9, 3.1, 40, 99, -99].map((place) => sliceAt(along, place)),
    [1, 1, 2, 20, 20, 1],
  );
});

test("the slices of an oblique plane cover the volume in steps of a voxel's shortest edge", () => {
  const volumes = volume(
    [11, 11, 11],
    [
      [1, 0, 0, 0],
      [0, 1, 0, 0],
      [0, 0, 2, 0],
      [0, 0, 0, 1],
    ],
  );
  assert.deepEqual(slicesAlong(volumes, [0.6, 0.8, 0]), { first_mm: 0, step_mm: 1, count: 15 });
});

test("a slab is sampled twice per voxel, and at its centre", () => {
  // slabs of 10 mm along slices of 1 mm, along pixels of 0.25 mm, and obliquely
  assert.equal(samplesThrough([0, 0, 10], 2), 21);
  assert.equal(samplesThrough([0, -40, 0], 2), 81);
  assert.equal(samplesThrough([20, -30.2, 4], 2), 63);
  assert.equal(samplesThrough([0, 0, 10], 1), 11);
  assert.equal(samplesThrough([0.1, 0, 0], 2), 3);
  for (const mm of [1, 2.3, 7, 50])
    for (const density of [1, 2]) {
      const places = samplesThrough([0, 0, mm], density);
      assert.equal(places % 2, 1);
      assert.ok(mm / (places - 1) <= 1 / density);
    }
});
