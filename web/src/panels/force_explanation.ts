// One-line explanation of the force: penetration and stiffness, tangential force, and limits of the output stage.

import { quantity } from "../words/figures.js";
import { length, reject, type Vec3 } from "../base/geometry.js";
import { Flag, type DevicePose } from "../protocol/wire.js";
import { words, type Words } from "../words/words.js";

/** Flags of limits that reduce the force on the hand below the contact force, the most likely first. */
const LIMITS: [number, keyof Words["reductionReasons"]][] = [
  [Flag.thermal, "thermal"],
  [Flag.clamped, "clamped"],
  [Flag.ramp, "ramp"],
  [Flag.passivity, "passivity"],
];
/** Fraction of the force below which a contribution is not mentioned: residual friction, rounding. */
const MIN_FRACTION = 0.05;
const MIN_FORCE_N = 0.005;

/** @param force  force on the hand, patient frame, N */
export function forceExplanation(device: DevicePose, force: Vec3): string {
  const force_N = length(force);
  if (!(device.flags & Flag.contact) || device.requestedForce < MIN_FORCE_N) return "";
  const reasons: string[] = [];
  // a single layer; those of several are listed with their shares
  if (device.path.length <= 1 && device.stiffness > 0 && Number.isFinite(device.depth)) {
    reasons.push(words.deepAt(quantity(device.depth, "mm"), quantity(device.stiffness, "N/mm")));
  }
  const along_N = length(reject(force, device.normal));
  if (length(device.normal) > 0 && along_N > Math.max(MIN_FORCE_N, MIN_FRACTION * force_N))
    reasons.push(words.alongSurface(quantity(along_N, "N")));
  if (device.requestedForce - force_N > Math.max(MIN_FORCE_N, MIN_FRACTION * device.requestedForce)) {
    const reason = LIMITS.find(([flag]) => device.flags & flag)?.[1] ?? "slew";
    reasons.push(
      words.lessBecause(quantity(force_N, "N"), quantity(device.requestedForce, "N"), words.reductionReasons[reason]),
    );
  }
  return reasons.join(" · ");
}
