// Why the force is what it is, in one line: the spring, what pulls along the surface, and what stands between that and the hand.

import { quantity } from "./figures.js";
import { length, reject, type Vec3 } from "./geometry.js";
import { Flag, type DevicePose } from "./wire.js";
import { words, type Words } from "./words.js";

/** What makes the hand's force less than the contact's, the most likely one first. */
const LESS: [number, keyof Words["because"]][] = [
  [Flag.thermal, "thermal"], [Flag.clamped, "clamped"], [Flag.ramp, "ramp"], [Flag.passivity, "passivity"],
];
/** Less than this part of a force is not told: friction on a smooth wall, rounding. */
const LEAST_PART = 0.05;
const LEAST_N = 0.005;

/** @param force  on the hand, in the patient, N */
export function whyText(device: DevicePose, force: Vec3): string {
  const force_N = length(force);
  if (!(device.flags & Flag.contact) || device.askedForce < LEAST_N) return "";
  const reasons: string[] = [];
  // of several layers each has its own stiffness, and its share stands in the list
  if (device.felt.length <= 1 && device.stiffness > 0 && Number.isFinite(device.depth)) {
    reasons.push(words.deepAt(quantity(device.depth, "mm"), quantity(device.stiffness, "N/mm")));
  }
  const along_N = length(reject(force, device.normal));
  if (length(device.normal) > 0 && along_N > Math.max(LEAST_N, LEAST_PART * force_N)) reasons.push(words.alongSurface(quantity(along_N, "N")));
  if (device.askedForce - force_N > Math.max(LEAST_N, LEAST_PART * device.askedForce)) {
    const reason = LESS.find(([flag]) => device.flags & flag)?.[1] ?? "slew";
    reasons.push(words.lessBecause(quantity(force_N, "N"), quantity(device.askedForce, "N"), words.because[reason]));
  }
  return reasons.join(" · ");
}
