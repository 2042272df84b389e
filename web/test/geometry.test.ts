import assert from "node:assert/strict";
import test from "node:test";
import {
  aboutAxis,
  anatomicalPlane,
  angleAt_deg,
  angleOf_deg,
  apply,
  compose,
  conjugate,
  cross,
  directionLetters,
  dot,
  hang,
  invert,
  length,
  multiply,
  niceLength,
  normalContaining,
  normalize,
  normalOf,
  orientationLetters,
  positionText,
  rotate,
  spread,
  sub,
  turn,
  type Affine,
  type Quaternion,
  type Vec3,
} from "../src/base/geometry.js";

let seed = Date.now() & 0x7fffffff;
const began = seed;
const random = () => ((seed = (seed * 1103515245 + 12345) & 0x7fffffff) / 0x7fffffff) * 2 - 1;
const vector = (): Vec3 => [random(), random(), random()];
const near = (a: readonly number[], b: readonly number[], most = 1e-9) =>
  a.forEach((x, i) => assert.ok(Math.abs(x - b[i]!) <= most, `${a} is not ${b} (seed ${began})`));

test("an affine map and its inverse cancel, with reflection and shear, too", () => {
  for (let i = 0; i < 200; i++) {
    const m: Affine = [
      [...vector(), 10],
      [...vector(), -20],
      [...vector(), 30],
      [0, 0, 0, 1],
    ];
    const columns = [0, 1, 2].map((c) => [m[0]![c]!, m[1]![c]!, m[2]![c]!] as Vec3);
    if (Math.abs(dot(columns[0]!, cross(columns[1]!, columns[2]!))) < 0.02) continue;
    const p = vector();
    near(apply(invert(m), apply(m, p)), p, 1e-8);
    near(turn(invert(m), turn(m, p)), p, 1e-8);
    near(apply(compose(m, invert(m)), p), p, 1e-8);
  }
});

test("the distance of two fingers gives the zoom factor", () => {
  assert.equal(spread([0, 0], [30, 40], [60, 80]), 2);
  assert.equal(spread([10, 0], [10, 100], [60, 0]), 0.5);
  assert.equal(spread([5, 5], [5, 5], [8, 9]), 5, "from the same place");
});

test("rotations follow the right-hand rule, preserve lengths and compose from right to left", () => {
  near(rotate(aboutAxis([0, 0, 1], Math.PI / 2), [1, 0, 0]), [0, 1, 0]);
  assert.ok(Math.abs(angleOf_deg(aboutAxis([1, 2, 3], 0.5)) - (0.5 * 180) / Math.PI) < 1e-9);
  for (let i = 0; i < 200; i++) {
    const [a, b] = [aboutAxis(vector(), 3 * random()), aboutAxis(vector(), 3 * random())];
    const v = vector();
    assert.ok(Math.abs(length(rotate(a, v)) - length(v)) < 1e-12);
    near(rotate(multiply(a, b), v), rotate(a, rotate(b, v)), 1e-12);
    near(rotate(conjugate(a), rotate(a, v)), v, 1e-12);
  }
});

test("orientation letters name the nearest direction, and further ones beyond 20 degrees", () => {
  assert.deepEqual(
    [
      [1, 0, 0],
      [-1, 0, 0],
      [0, 1, 0],
      [0, -1, 0],
      [0, 0, 1],
      [0, 0, -1],
    ].map((v) => directionLetters(v as Vec3)),
    ["L", "R", "P", "A", "S", "I"],
  );
  const between = (degrees: number): Vec3 => [
    Math.cos((degrees * Math.PI) / 180),
    -Math.sin((degrees * Math.PI) / 180),
    0,
  ];
  assert.equal(directionLetters(between(19.9)), "L");
  assert.equal(directionLetters(between(20)), "L");
  assert.equal(directionLetters(between(20.1)), "LA");
  assert.equal(directionLetters(between(69.9)), "AL");
  assert.equal(directionLetters(between(70.1)), "A");
  assert.equal(directionLetters([0.8, -0.5, 0.4]), "LAS");
});

test("planes have radiological orientation", () => {
  const centre: Vec3 = [1, 2, 3];
  const letters = (kind: "axial" | "sagittal" | "coronal") => {
    const { right, down } = anatomicalPlane(kind, centre);
    return orientationLetters(right, down);
  };
  assert.deepEqual(letters("axial"), { left: "R", right: "L", top: "A", bottom: "P" });
  assert.deepEqual(letters("coronal"), { left: "R", right: "L", top: "S", bottom: "I" });
  assert.deepEqual(letters("sagittal"), { left: "A", right: "P", top: "S", bottom: "I" });
});

test("an oblique plane is oriented like the nearest anatomical plane, for either sign of its normal", () => {
  const shown = (normal: Vec3) => {
    const { right, down } = hang(normal, [0, 0, 0]).plane;
    return orientationLetters(right, down);
  };
  for (const sign of [1, -1]) {
    assert.deepEqual(shown([0.05, 0.05, sign]), { left: "R", right: "L", top: "A", bottom: "P" });
    assert.deepEqual(shown([sign, 0.05, 0.05]), { left: "A", right: "P", top: "S", bottom: "I" });
    assert.deepEqual(shown([0.05, sign, 0.05]), { left: "R", right: "L", top: "S", bottom: "I" });
    assert.deepEqual(shown([0.6 * sign, 0.8 * sign, 0]), { left: "RP", right: "LA", top: "S", bottom: "I" });
  }
  for (let i = 0; i < 500; i++) {
    const normal = normalize(vector());
    const { right, down } = hang(normal, [0, 0, 0]).plane;
    near([length(right), length(down), dot(right, down), dot(right, normal), dot(down, normal)], [1, 1, 0, 0, 0], 1e-9);
    near([Math.abs(dot(normalOf({ centre: [0, 0, 0], right, down }), normal))], [1], 1e-9);
  }
});

test("the orientation of a plane has hysteresis", () => {
  const at = (x: number): Vec3 => [x, Math.sqrt(1 - x * x), 0];
  const before = hang(at(0.9), [0, 0, 0]).hanging;
  assert.equal(before.sagittal, true);
  assert.equal(hang(at(0.77), [0, 0, 0], before).hanging.sagittal, true);
  assert.equal(hang(at(0.7), [0, 0, 0], before).hanging.sagittal, false);
  assert.equal(hang(at(0.83), [0, 0, 0], { axial: false, sagittal: false }).hanging.sagittal, false);
});

test("the section contains the followed direction and is as close as possible to the preferred plane", () => {
  for (let i = 0; i < 500; i++) {
    const direction = normalize(vector());
    const normal = normalContaining(direction, [1, 0, 0], [0, 1, 0]);
    near([dot(normal, direction), length(normal)], [0, 1], 1e-9);
    // no rotation about the contained direction brings the normal closer
    const other = rotate(aboutAxis(direction, 0.2), normal);
    if (length(cross(direction, [1, 0, 0])) > 0.2) assert.ok(dot(normal, [1, 0, 0]) >= dot(other, [1, 0, 0]) - 1e-12);
  }
  near(normalContaining([1, 0, 0], [1, 0, 0], [0, 1, 0]), [0, 1, 0]);
});

test("positions name their convention, and RAS negates two coordinates", () => {
  assert.equal(positionText([1.25, -2, 3], "LPS", 1), "LPS +1.3  −2.0  +3.0 mm");
  assert.equal(positionText([1.25, -2, 3], "RAS", 1), "RAS −1.3  +2.0  +3.0 mm");
});

test("scale bars are 1, 2 or 5 times a power of ten", () => {
  assert.deepEqual([0.09, 1, 1.9, 4.9, 5, 23, 99].map(niceLength), [0.05, 1, 1, 2, 5, 20, 50]);
});

test("an angle is measured at its vertex", () => {
  assert.ok(Math.abs(angleAt_deg([0, 0, 0], [2, 0, 0], [0, 0, 5]) - 90) < 1e-9);
  for (let i = 0; i < 100; i++) {
    const [a, b, c] = [vector(), vector(), vector()];
    const sum = angleAt_deg(a, b, c) + angleAt_deg(b, c, a) + angleAt_deg(c, a, b);
    if (length(cross(sub(b, a), sub(c, a))) > 0.01) assert.ok(Math.abs(sum - 180) < 1e-6, `seed ${began}`);
  }
});

test("a quaternion and its negative are one rotation", () => {
  const q: Quaternion = aboutAxis([0, 1, 0], 0.3);
  assert.ok(Math.abs(angleOf_deg(q) - angleOf_deg(q.map((x) => -x) as Quaternion)) < 1e-12);
});
