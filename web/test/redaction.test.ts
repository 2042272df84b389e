import type { Scene } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import { Camera } from "../src/volume/camera.js";
import { cross, dot, type Affine, type Vec3 } from "../src/base/geometry.js";
import { redact, revealed } from "../src/training/redaction.js";
import { Volumes } from "../src/protocol/scene.js";

const UNIT: Affine = [
  [1, 0, 0, 0],
  [0, 1, 0, 0],
  [0, 0, 1, 0],
  [0, 0, 0, 1],
];
const scene = {
  structures: [
    { label: 4, name: "soft", tissue: 0 },
    { label: 9, name: "nodule", tissue: 1 },
    { label: 5, name: "plate", tissue: 2 },
  ],
} as unknown as Scene;

/** Volume with a nodule of 3 x 3 x 3 voxels in soft tissue, one corner of it in a plate. */
function block(): Volumes {
  const dims: Vec3 = [9, 8, 7];
  const structure = new Uint8Array(9 * 8 * 7);
  for (let k = 0, n = 0; k < 7; k++)
    for (let j = 0; j < 8; j++)
      for (let i = 0; i < 9; i++, n++) {
        const isNodule = [i - 4, j - 4, k - 3].every((d) => Math.abs(d) <= 1);
        structure[n] = i === 0 ? 0 : isNodule ? 2 : i > 5 ? 3 : 1;
      }
  return new Volumes("0", 1, dims, UNIT, null, structure, 1, 0);
}

test("the target is drawn like its surroundings, and restored afterwards", () => {
  const volumes = block();
  const whole = volumes.structure.slice();
  const redacted = redact(scene, volumes, [9])!;
  assert.deepEqual(
    [redacted.lo, redacted.size],
    [
      [3, 3, 2],
      [3, 3, 3],
    ],
  );
  assert.deepEqual([redacted.values, redacted.as], [[2], 1], "also of its colour");
  volumes.write(redacted.lo, redacted.size, redacted.now);
  assert.ok(!volumes.structure.includes(2));
  assert.equal(volumes.structureAt([4, 4, 3]), 0, "soft tissue");
  // voxels that are cut during the concealment are not restored
  volumes.write([4, 4, 3], [1, 1, 1], new Uint8Array([0]));
  volumes.write(redacted.lo, redacted.size, revealed(volumes, redacted));
  whole[4 + 9 * (4 + 8 * 3)] = 0;
  assert.deepEqual(volumes.structure, whole);
});

/** Displayed voxels of a block, defined by a rule, while the nodule is concealed. */
function shownOf(
  dims: Vec3,
  value: (i: number, j: number, k: number) => number,
): { whole: Uint8Array; shown: Uint8Array } {
  const whole = Uint8Array.from({ length: dims[0] * dims[1] * dims[2] }, (_, n) =>
    value(n % dims[0], Math.floor(n / dims[0]) % dims[1], Math.floor(n / (dims[0] * dims[1]))),
  );
  const volumes = new Volumes("0", 1, dims, UNIT, null, whole.slice(), 1, 0);
  const redacted = redact(scene, volumes, [9])!;
  volumes.write(redacted.lo, redacted.size, redacted.now);
  return { whole, shown: volumes.structure };
}

test("a target that borders mostly on air is not drawn as air", () => {
  const { whole, shown } = shownOf([15, 15, 15], (i, j, k) =>
    k < 7 ? 1 : (i - 7) ** 2 + (j - 7) ** 2 + (k - 7) ** 2 <= 9 ? 2 : 0,
  );
  assert.deepEqual(
    shown,
    whole.map((value) => (value === 2 ? 1 : value)),
  );
});

test("a thin layer continues over the plate below it", () => {
  const { whole, shown } = shownOf([24, 24, 24], (i, j, k) =>
    k < 10 ? 3 : k >= 13 ? 0 : (i - 12) ** 2 + (j - 12) ** 2 + (k - 12) ** 2 <= 25 ? 2 : 1,
  );
  assert.deepEqual(
    shown,
    whole.map((value) => (value === 2 ? 1 : value)),
  );
});

test("a border continues through the concealed target", () => {
  const { shown } = shownOf([24, 24, 24], (i, j, k) =>
    (i - 12) ** 2 + (j - 12) ** 2 + (k - 12) ** 2 <= 27 ? 2 : k < 12 ? 3 : 1,
  );
  assert.ok(shown.every((value, n) => value === (Math.floor(n / 576) < 12 ? 3 : 1)));
});

test("a target that touches only air is drawn as air", () => {
  const { shown } = shownOf([9, 9, 9], (i, j, k) => (i === 7 && j === 4 && k === 4 ? 2 : i < 4 ? 1 : 0));
  assert.equal(shown[7 + 9 * (4 + 9 * 4)], 0);
});

test("a quiz without an answer, or with an empty one, conceals no voxels", () => {
  assert.equal(redact(scene, block(), []), null);
  assert.equal(redact(scene, block(), [77]), null);
});

test("a position is viewed from outside, with superior up if possible", () => {
  for (const outward of [
    [0, -1, 0],
    [0.6, 0, 0.8],
    [0, 0, 1],
    [0, 0, -1],
  ] as Vec3[]) {
    const camera = new Camera();
    camera.setWorldFromPatient([
      [1, 0, 0, 0],
      [0, 0, 1, 0],
      [0, -1, 0, 0],
      [0, 0, 0, 1],
    ]);
    camera.alignView(outward);
    const { backward, up, right } = camera.inPatient();
    assert.ok(dot(backward, outward) > 1 - 1e-12);
    assert.ok(dot(cross(right, up), backward) > 1 - 1e-12);
    if (Math.abs(outward[2]) < 0.9) assert.ok(up[2] > 0.5);
  }
  const camera = new Camera();
  const { right, up } = camera;
  camera.alignView([0, 0, 0]);
  assert.deepEqual([camera.right, camera.up], [right, up]);
});
