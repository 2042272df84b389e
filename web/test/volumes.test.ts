import assert from "node:assert/strict";
import test from "node:test";
import { Camera } from "../src/camera.js";
import { alphaOf, coarsening, colourField } from "../src/field.js";
import { aboutAxis, apply, dot, cross, sub, type Affine, type Vec3 } from "../src/geometry.js";
import { shrinkFor, shrunkGrid, Volumes } from "../src/scene.js";
import { fromSlider, toSlider } from "../src/structures_panel.js";

const grid: Affine = [[0.5, 0, 0, -10], [0, 0.5, 0, -20], [0, 0, 2, 5], [0, 0, 0, 1]];
const mirrored: Affine = [[-0.5, 0, 0, -10], [0, 0.5, 0, -20], [0, 0, 2, 5], [0, 0, 0, 1]];
const near = (a: readonly number[], b: readonly number[]) => a.forEach((x, i) => assert.ok(Math.abs(x - b[i]!) < 1e-9, `${a} is not ${b}`));

test("a shrunk voxel lies in the middle of those that it is the mean of", () => {
  for (const shrink of [2, 4]) {
    const corners = [0, shrink - 1].map((i) => apply(grid, [i, i, i]));
    near(apply(shrunkGrid(grid, shrink), [0, 0, 0]), corners[0]!.map((x, axis) => (x + corners[1]![axis]!) / 2));
  }
});

test("a volume is shrunk until it suits the device", () => {
  assert.equal(shrinkFor([256, 256, 124], { mostSide: 2048, mostTexels: 1e7 }), 1);
  assert.equal(shrinkFor([256, 256, 124], { mostSide: 2048, mostTexels: 1e6 * 2 }), 2);
  assert.equal(shrinkFor([256, 256, 124], { mostSide: 2048, mostTexels: 1e5 * 2 }), 4);
  assert.equal(shrinkFor([600, 100, 100], { mostSide: 512, mostTexels: 1e9 }), 2);
  assert.equal(coarsening([100, 100, 100], 1e6), 1);
  assert.equal(coarsening([100, 100, 101], 1e6), 2);
});

function cube(patientFromVoxel: Affine): Volumes {
  const dims: Vec3 = [12, 12, 12];
  const structure = new Uint8Array(1728);
  const scan = new Int16Array(1728);
  for (let k = 3; k < 9; k++) for (let j = 3; j < 9; j++) for (let i = 3; i < 6; i++) structure[i + 12 * (j + 12 * k)] = 2;
  scan[1 + 12 * (2 + 12 * 3)] = 40;
  return new Volumes("h", 1, dims, patientFromVoxel, scan, structure, 2, -7);
}

test("values and structures are read at positions of the patient", () => {
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

test("the colour field shows a structure's colour where it is, mirrored grids too", () => {
  const looks = [{ colour: [1, 2, 3] as Vec3, opacity: 1, visible: true }, { colour: [200, 100, 50] as Vec3, opacity: 1, visible: true }];
  for (const m of [grid, mirrored]) {
    const volumes = cube(m);
    const field = colourField(volumes, looks, 0, [0, 1], 1e6);
    assert.ok(dot(cross(field.direction[0], field.direction[1]), field.direction[2]) > 0.99, "right-handed");
    const at = (p: Vec3) => {
      const v = [0, 1, 2].map((axis) => Math.round(dot(sub(p, field.origin), field.direction[axis]!) / field.spacing[axis]!));
      return [...field.rgba.slice(4 * (v[0]! + 12 * (v[1]! + 12 * v[2]!))).slice(0, 4)];
    };
    const inside = at(apply(m, [4, 5, 5]));
    [200, 100, 50, 255].forEach((x, c) => assert.ok(Math.abs(inside[c]! - x) <= 2, `${inside}`));
    assert.deepEqual(at(apply(m, [8, 5, 5])), [0, 0, 0, 0]);
    // the surface, where coverage is one half, is between the voxels on both sides of it
    assert.ok(at(apply(m, [5, 5, 5]))[3]! > 128 && at(apply(m, [6, 5, 5]))[3]! < 128);
    // its colour is not mixed with that of nothing
    assert.ok(Math.abs(at(apply(m, [6, 5, 5]))[0]! - 200) <= 3);
  }
});

test("a hidden structure is nowhere in the colour field", () => {
  const look = { colour: [200, 100, 50] as Vec3, opacity: 1, visible: false };
  assert.ok(colourField(cube(grid), [look, look], 0, [0, 1], 1e6).rgba.every((x) => x === 0));
  assert.equal(alphaOf(0), 0);
  assert.equal(alphaOf(1), 255);
});

const worldFromPatient: Affine = [[1, 0, 0, 4], [0, 0, 1, 5], [0, -1, 0, 6], [0, 0, 0, 1]];

test("seen from anterior, the patient's left is on picture right and the head on top", () => {
  const camera = new Camera();
  camera.place(worldFromPatient);
  for (const rotation of [[1, 0, 0, 0], aboutAxis([1, 2, 3], 1.1)] as const) {
    camera.setRotation([...rotation] as [number, number, number, number]);
    camera.look("anterior");
    const origin = camera.project([0, 0, 0]);
    const [left, up, front] = [[1, 0, 0], [0, 0, 1], [0, -1, 0]].map((p) => sub([...camera.project(p as Vec3), 0], [...origin, 0]));
    assert.ok(left![0]! > 0 && Math.abs(left![1]!) < 1e-9);
    assert.ok(up![1]! < 0 && Math.abs(up![0]!) < 1e-9);
    assert.ok(Math.hypot(...front!) < 1e-9);
    assert.ok(dot(camera.directionToPatient(camera.backward()), [0, -1, 0]) > 0.999999, "the viewer is in front");
  }
});

test("a point of the picture leads back to the patient", () => {
  const camera = new Camera();
  camera.place(worldFromPatient);
  camera.setRotation(aboutAxis([3, -1, 2], 0.8));
  camera.orbit(40, -70);
  const p: Vec3 = [12, -7, 31];
  near(camera.unproject(...camera.project(p), p), p);
});

test("dragging to the right brings the front to the right", () => {
  const camera = new Camera();
  camera.place(worldFromPatient);
  camera.look("anterior");
  const front = apply(worldFromPatient, [0, -50, 0]);
  const [x] = camera.project([0, -50, 0]);
  camera.setRotation(camera.dragged(30, 0));
  assert.ok(camera.project([0, -50, 0])[0] > x, `${front}`);
});

test("a stiffness slider goes by ratios and comes back", () => {
  const limits: [number, number] = [0.01, 10];
  assert.equal(toSlider(0.01, limits), 0);
  assert.equal(toSlider(10, limits), 1);
  assert.ok(Math.abs(toSlider(1, limits) - 2 / 3) < 1e-12);
  for (const value of [0.02, 0.35, 1.1, 9]) assert.equal(fromSlider(toSlider(value, limits), limits), value);
});
