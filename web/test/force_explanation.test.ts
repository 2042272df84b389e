import assert from "node:assert/strict";
import test from "node:test";
import { Flag, type DevicePose } from "../src/protocol/wire.js";
import { forceExplanation } from "../src/panels/force_explanation.js";

/** Pose at a penetration of 0.5 mm into a half-space of 2 N/mm with normal +z. */
const pressed = (other: Partial<DevicePose> = {}): DevicePose => ({
  number: 0,
  tip: [0, 0, -0.5],
  proxy: [0, 0, 0],
  normal: [0, 0, 1],
  orientation: [1, 0, 0, 0],
  force: [0, 0, 1],
  requestedForce: 1,
  forceLimit: 3,
  heat: 0,
  depth: 0.5,
  speed: 0,
  stiffness: 2,
  flags: Flag.contact,
  buttons: 0,
  cuttingForce: 0,
  cuttingEnergy: 0,
  label: 1,
  path: [{ label: 1, depth: 0.5, share: 1 }],
  contacts: [],
  ...other,
});

test("the explanation names the spring, and is empty in free space", () => {
  assert.equal(forceExplanation(pressed(), [0, 0, 1]), "0.500 mm deep at 2.00 N/mm");
  assert.equal(forceExplanation(pressed({ flags: 0, requestedForce: 0 }), [0, 0, 0]), "");
});

test("for several layers the list replaces the explanation of the spring", () => {
  const path = [
    { label: 1, depth: 10, share: 0.05 },
    { label: 2, depth: 5, share: 0.95 },
  ];
  assert.equal(forceExplanation(pressed({ path }), [0, 0, 1]), "");
});

test("a perceptible tangential force is displayed", () => {
  assert.equal(
    forceExplanation(pressed({ requestedForce: Math.hypot(1, 0.2) }), [0.2, 0, 1]),
    "0.500 mm deep at 2.00 N/mm · 0.200 N along the surface",
  );
  assert.equal(forceExplanation(pressed(), [0.03, 0, 1]), "0.500 mm deep at 2.00 N/mm");
});

test("a reduction of the force is displayed with its most likely reason", () => {
  const less = (flags: number) =>
    forceExplanation(pressed({ requestedForce: 4, depth: 2, flags: Flag.contact | flags }), [0, 0, 3]);
  assert.equal(less(Flag.clamped), "2.00 mm deep at 2.00 N/mm · reduced from 4.00 N to 3.00 N: force limit");
  assert.equal(
    less(Flag.clamped | Flag.thermal),
    "2.00 mm deep at 2.00 N/mm · reduced from 4.00 N to 3.00 N: motors warm",
  );
  assert.equal(less(Flag.ramp), "2.00 mm deep at 2.00 N/mm · reduced from 4.00 N to 3.00 N: fading in");
  assert.equal(
    less(Flag.passivity),
    "2.00 mm deep at 2.00 N/mm · reduced from 4.00 N to 3.00 N: damped against oscillation",
  );
  assert.equal(less(0), "2.00 mm deep at 2.00 N/mm · reduced from 4.00 N to 3.00 N: rate of change limited");
  // a difference of 1 % is rounding
  assert.equal(forceExplanation(pressed({ requestedForce: 1.01 }), [0, 0, 1]), "0.500 mm deep at 2.00 N/mm");
});
