import assert from "node:assert/strict";
import test from "node:test";
import { Camera } from "../src/volume/camera.js";
import {
  add,
  anatomicalPlane,
  apply,
  cross,
  dot,
  length,
  scale,
  sub,
  type Affine,
  type Vec3,
} from "../src/base/geometry.js";
import { boxSection, runs } from "../src/drawing/in_volume.js";
import { Volumes } from "../src/protocol/scene.js";
import { OPTICS_DEG, Scope, standOff } from "../src/volume/scope.js";
import { firstTouchable, SurfaceBelowTool } from "../src/touch/surface.js";
import { pathTo } from "../src/touch/surface_drag.js";
import { Found, viewOf } from "../src/volume/view.js";

const near = (a: readonly number[], b: readonly number[], within = 1e-9) =>
  a.forEach((x, i) => assert.ok(Math.abs(x - b[i]!) < within, `${a} is not ${b}`));
const degrees = (a: Vec3, b: Vec3) => (Math.acos(Math.min(1, dot(a, b))) * 180) / Math.PI;
const worldFromPatient: Affine = [
  [1, 0, 0, 4],
  [0, 0, 1, 5],
  [0, -1, 0, 6],
  [0, 0, 0, 1],
];

test("the scope looks at the angle of its optics to the shaft, and the light post rotates it about the shaft", () => {
  const scope = new Scope();
  scope.back_mm = 0;
  const axes: [Vec3, Vec3, Vec3] = [
    [0, 1, 0],
    [0, 0, 1],
    [1, 0, 0],
  ];
  for (const angle of OPTICS_DEG) {
    scope.optics_deg = angle;
    for (const post of [0, 45, 180, 300]) {
      scope.post_deg = post;
      const { eye, forward, right, up } = scope.frame([1, 2, 3], axes);
      near(eye, [1, 2, 3]);
      assert.ok(Math.abs(degrees(forward, [-1, 0, 0]) - angle) < 1e-6);
      near(cross(right, forward), up);
      if (angle === 0) near(up, axes[1]);
      else
        near(
          [dot(forward, axes[0]), dot(forward, axes[1])],
          [Math.sin, Math.cos].map((f) => f((post * Math.PI) / 180) * Math.sin((angle * Math.PI) / 180)),
        );
    }
  }
  scope.post_deg = 0;
  scope.turnPost(-15);
  assert.equal(scope.post_deg, 345);
});

test("a moved scope keeps its position until it returns to the tip", () => {
  const scope = new Scope();
  scope.back_mm = 0;
  scope.optics_deg = 0;
  const axes: [Vec3, Vec3, Vec3] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
  ];
  scope.move(scope.frame([0, 0, 0], axes), Math.PI / 2, 0, 7);
  const { eye, forward, up } = scope.frame([50, 50, 50], axes);
  near(forward, [1, 0, 0]);
  near(eye, [7, 0, 0]);
  near(up, [0, 1, 0]);
  scope.move(scope.frame([50, 50, 50], axes), 0, Math.PI / 6, 0);
  assert.ok(degrees(scope.frame([0, 0, 0], axes).forward, [0, 1, 0]) < 60 + 1e-6);
  assert.equal(scope.isFree, true);
  scope.toTip();
  near(scope.frame([50, 50, 50], axes).eye, [50, 50, 50]);
});

test("the scope's stand-off is minimal, centred in a gap and within its bounds", () => {
  const between = (from: number, to: number, most = 8) => standOff((off) => off < from || off > to, most, 1.5, 0.05);
  near([between(0, 100)!, between(2, 100)!, between(7.5, 100)!], [1.5, 3.5, 8], 0.06);
  near([between(2, 3)!], [2.5], 0.06);
  assert.equal(between(9, 100), null);
  assert.equal(between(1, 100, 0), null);
});

test("in perspective, closer objects are larger, and unprojected pixels return their points", () => {
  const camera = new Camera();
  camera.setWorldFromPatient(worldFromPatient);
  camera.orbit(40, -70);
  const parallel = [
    [0, 0, 0],
    [20, 0, 5],
  ].map((p) => camera.project(p as Vec3));
  camera.isPerspective = true;
  const p: Vec3 = [12, -7, 31];
  near(camera.unproject(...camera.project(p), p), p);
  const { from, into } = camera.ray(...camera.project(p));
  near(add(from, scale(into, length(sub(p, from)))), p);
  near(camera.project(camera.toPatient(camera.focus)), [0, 0]);
  const towards = camera.directionToPatient(camera.backward());
  const apart = (at: Vec3) => {
    const ends = [at, add(at, camera.directionToPatient(camera.right))].map((end) => camera.project(end));
    return ends[1]![0] - ends[0]![0];
  };
  assert.ok(
    Math.abs(apart(camera.toPatient(camera.focus)) * camera.mmPerPixel - 1) < 1e-9,
    "as large as it was at the focus",
  );
  assert.ok(apart(add(p, scale(towards, 40))) > 1.05 * apart(p));
  camera.isPerspective = false;
  near(camera.project([20, 0, 5]), parallel[1]!);
});

test("the depth of a picture determines the occlusion of a point", () => {
  for (const isPerspective of [false, true]) {
    const camera = new Camera();
    camera.setWorldFromPatient(worldFromPatient);
    camera.orbit(10, 20);
    camera.isPerspective = isPerspective;
    const view = viewOf(camera, 64, 32, 1);
    const bytes = new Uint8Array(4 * 64 * 32);
    const [least, extent] = [-100, 2000];
    const p = camera.unproject(10, -6, camera.toPatient(camera.focus));
    const away = camera.ray(10, -6).into;
    // a single pixel has a structure; its centre is half a pixel right of and below its corner
    const way = new Found(bytes, view, least, extent).project(p)!.way_mm;
    const at = 4 * (42 + 64 * (31 - 10));
    const steps = Math.round((65535 * (way - least)) / extent);
    bytes.set([steps >> 8, steps & 255, 5], at);
    const found = new Found(bytes, view, least, extent);
    const there = found.project(add(p, scale(away, 0.3)))!;
    near([there.x * 64, there.y * 32], [42, 10], 1e-6);
    const inPixel = (by: number) => camera.unproject(10.5, -5.5, add(p, scale(away, by)));
    assert.deepEqual(
      [found.hides(inPixel(9), 1), found.hides(inPixel(0.5), 1), found.hides(inPixel(-9), 1)],
      [true, false, false],
    );
    assert.equal(found.at(42.5 / 64, 10.5 / 32)!.structure, 4);
    assert.equal(found.hides(camera.unproject(12, -5.5, inPixel(9)), 1), false, "beside it nothing is in front");
    assert.equal(found.at(1.2, 0.5), null);
  }
});

/** Volume of 40^3 voxels of 1 mm on a mirrored grid: a ball of radius 8 mm at the centre and a plate behind it. */
function room(): { volumes: Volumes; isTouchable: (p: Vec3) => boolean } {
  const dims: Vec3 = [40, 40, 40];
  const structure = new Uint8Array(64000);
  for (let n = 0; n < 64000; n++) {
    const v = [n % 40, Math.floor(n / 40) % 40, Math.floor(n / 1600)];
    if (Math.hypot(v[0]! - 20, v[1]! - 20, v[2]! - 20) < 8) structure[n] = 1;
    else if (v[1]! > 35) structure[n] = 2;
  }
  const volumes = new Volumes(
    "h",
    1,
    dims,
    [
      [-1, 0, 0, 20],
      [0, 1, 0, -20],
      [0, 0, 1, -20],
      [0, 0, 0, 1],
    ],
    null,
    structure,
    1,
    0,
  );
  return { volumes, isTouchable: (p) => volumes.structureAt(p) !== null };
}

test("a press picks the first surface under it", () => {
  const { volumes, isTouchable } = room();
  near(firstTouchable(volumes, isTouchable, [0, -100, 0], [0, 1, 0])!, [0, -7.5, 0], 0.02);
  near(firstTouchable(volumes, isTouchable, [12, 100, 0], [0, 1, 0])!, [12, 15.5, 0], 0.02);
  near(firstTouchable(volumes, isTouchable, [0, 0, 0], [0, 1, 0], 9)!, [0, 15.5, 0], 0.02);
  assert.equal(firstTouchable(volumes, isTouchable, [30, -100, 0], [0, 1, 0]), null);
  const isWall = (p: Vec3) => volumes.structureAt(p) === 1;
  near(firstTouchable(volumes, isWall, [0, -100, 0], [0, 1, 0])!, [0, 15.5, 0], 0.02);
});

test("the path of the tip to a surface avoids felt structures", () => {
  const { volumes, isTouchable } = room();
  const into: Vec3 = [0, 1, 0];
  let paths = 0,
    setDowns = 0;
  // tips behind the ball, next to it, in front of it, and within it
  for (const tip of [
    [0, 11, 0],
    [14, 0, 0],
    [0, -12, 0],
    [0, -7, 0],
    [-2, 10, 9],
  ] as Vec3[]) {
    for (const [x, z] of [
      [0, 0],
      [3, -4],
      [-12, 2],
      [6, 0],
    ] as const) {
      const surface = firstTouchable(volumes, isTouchable, [x, -100, z], into)!;
      const path = pathTo(isTouchable, tip, surface, into, 0.5);
      let from = tip,
        hasLeft = false,
        through_mm = 0,
        path_mm = 0;
      for (const { at: to, isSetDown } of path) {
        if (isSetDown) {
          setDowns += 1;
          assert.ok(path.length === 1 && !isTouchable(to), "it is released, and set down where it is free");
          continue;
        }
        path_mm += length(sub(to, from));
        for (let n = 0; n <= 200; n++) {
          const felt = isTouchable(add(from, scale(sub(to, from), n / 200)));
          hasLeft ||= !felt;
          through_mm = felt && (hasLeft || !isTouchable(tip)) ? through_mm + length(sub(to, from)) / 200 : 0;
          // tolerance: the corner of a voxel
          assert.ok(through_mm < 0.6, `${tip} to ${surface}: through something on the way to ${to}`);
        }
        from = to;
      }
      assert.ok(path_mm <= length(sub(tip, surface)) + 60, `${path_mm} mm to ${surface}`);
      assert.ok(length(sub(path.at(-1)!.at, surface)) <= 3 + 1e-9, "and it is in front of the surface");
      paths += 1;
    }
  }
  assert.ok(setDowns > 0 && setDowns < paths / 2, `${setDowns} of ${paths}`);
});

test("the height is the distance to the nearest felt structure", () => {
  const { volumes, isTouchable } = room();
  const ground = new SurfaceBelowTool(volumes, 20, 9000);
  for (const p of [
    [0, -15, 0],
    [0.3, 12, 0.4],
    [-11, -5, 3],
    [9, 9, 9],
  ] as Vec3[]) {
    let least = Infinity;
    for (let n = 0; n < 64000; n++) {
      if (volumes.structure[n] === 0) continue;
      const voxel = apply(volumes.patientFromVoxel, [n % 40, Math.floor(n / 40) % 40, Math.floor(n / 1600)]);
      least = Math.min(least, length(sub(voxel, p)));
    }
    const found = ground.below(p, isTouchable)!;
    assert.ok(Math.abs(found.height_mm - (least - 0.5)) < 0.4, `${found.height_mm} is not ${least - 0.5}`);
    assert.ok(Math.abs(length(sub(found.foot, p)) - found.height_mm) < 1e-9);
  }
  assert.equal(ground.below([0, 0, 0], isTouchable), null, "none where it is within");
  assert.equal(new SurfaceBelowTool(volumes, 3).below([0, -15, 0], isTouchable), null, "none where it is far");
});

test("the structure below a tool is searched again after movements and changes of voxels", () => {
  const { volumes, isTouchable } = room();
  const ground = new SurfaceBelowTool(volumes, 20, 9000);
  let looked = 0;
  const counted = (p: Vec3) => ((looked += 1), isTouchable(p));
  const appearances = (act: () => unknown) => {
    const before = looked;
    act();
    return looked > before;
  };
  const [one, other]: Vec3[] = [
    [0, -15, 0],
    [0.3, 12, 0.4],
  ];
  assert.ok(appearances(() => assert.deepEqual(ground.belowTool(0, one!, counted), ground.below(one!, isTouchable))));
  assert.ok(!appearances(() => assert.deepEqual(ground.belowTool(0, one!, counted), ground.below(one!, isTouchable))));
  assert.ok(
    appearances(() => assert.deepEqual(ground.belowTool(0, other!, counted), ground.below(other!, isTouchable))),
    "it has moved",
  );
  assert.ok(
    appearances(() => ground.belowTool(1, other!, counted)),
    "another tool",
  );
  volumes.structure.fill(0);
  ground.forget();
  assert.ok(
    appearances(() => assert.equal(ground.belowTool(0, other!, counted), null)),
    "nothing is there any more",
  );
});

test("the outline of a plane is its intersection with the volume's box", () => {
  const { volumes } = room();
  const square = boxSection(anatomicalPlane("axial", [0, 0, 3]), volumes);
  assert.equal(square.length, 4);
  for (const [n, p] of square.entries()) {
    assert.ok(Math.abs(p[2] - 3) < 1e-9);
    assert.ok(Math.abs(length(sub(p, square[(n + 1) % 4]!)) - 40) < 1e-9, "its corners in their order");
  }
  const right: Vec3 = [Math.SQRT1_2, -Math.SQRT1_2, 0];
  const tilted = {
    centre: [0, 0, 0] as Vec3,
    right,
    down: cross([1, 1, 1].map((x) => x / Math.sqrt(3)) as Vec3, right),
  };
  assert.equal(boxSection(tilted, volumes).length, 6);
  assert.equal(boxSection(anatomicalPlane("coronal", [0, 90, 0]), volumes).length, 0);
});

test("occluded parts of a line are hidden", () => {
  const parts = runs([0, 0, 0], [10, 0, 0], 10, ([x]) => x > 3 && x < 6);
  assert.deepEqual(
    parts.map(({ from, to, isHidden }) => [from[0], to[0], isHidden]),
    [
      [0, 3, false],
      [3, 6, true],
      [6, 10, false],
    ],
  );
});
