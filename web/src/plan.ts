// A plan that is rehearsed: trajectories from an entry to a target, and what the tool is to keep away from. Patient, mm.

import { add, angleAt_deg, dot, length, normalize, scale, sub, type Vec3 } from "./geometry.js";
import type { NearStructure } from "./near.js";
import type { HeldTool } from "./scene.js";

export interface Trajectory {
  name: string;
  entry_mm: Vec3;
  target_mm: Vec3;
  entry_within_mm: number | null;
  target_within_mm: number | null;
  angle_within_deg: number | null;
  depth_within_mm: number | null;
}
/** As palpate tells it. */
export interface Plan {
  version: number;
  saved: boolean; // its file says the same
  can_change: boolean; // viewers with control may
  trajectories: Trajectory[];
  keep_away: { label: number; mm: number }[];
}

/** A tip beside a trajectory. */
export interface Beside {
  lateral_mm: number; // from its line
  left_mm: number; // to the depth of its target, below 0 beyond
  angle_deg: number | null; // between it and the tool's shaft, from the handle to the tip; null: not known
}
/** @param shaft  unit, from the tip to the handle; null: the tool has none that is known, or nothing tells how it is turned */
export function besideTrajectory({ entry_mm, target_mm }: Trajectory, tip: Vec3, shaft: Vec3 | null): Beside {
  const axis = normalize(sub(target_mm, entry_mm));
  const left_mm = dot(sub(target_mm, tip), axis);
  const lateral_mm = length(sub(add(tip, scale(axis, left_mm)), target_mm));
  const angle_deg = shaft && angleAt_deg([0, 0, 0], scale(shaft, -1), axis);
  return { lateral_mm, left_mm, angle_deg };
}
/** From a trajectory, the part between its ends, to a place. */
export function toTrajectory({ entry_mm, target_mm }: Trajectory, place: Vec3): number {
  const way = sub(target_mm, entry_mm);
  const share = Math.min(1, Math.max(0, dot(sub(place, entry_mm), way) / dot(way, way)));
  return length(sub(add(entry_mm, scale(way, share)), place));
}

/** In the tool's own frame, from the tip to the handle: along the longest of its capsules, which the head of a burr that is no ball is too. */
export function shaftOf({ capsules }: HeldTool): Vec3 | null {
  const [longest] = capsules.map(({ from_mm, to_mm }) => (length(to_mm) >= length(from_mm) ? sub(to_mm, from_mm) : sub(from_mm, to_mm))).sort((a, b) => length(b) - length(a));
  return longest && length(longest) > 0 ? normalize(longest) : null;
}

/** A structure that is nearer than the plan asks. */
export interface Breach { label: number; mm: number; asked_mm: number }
/** Of what is told to be near. The one of which most is missing comes first. */
export function breachesOf({ keep_away }: Plan, near: NearStructure[]): Breach[] {
  return keep_away.flatMap(({ label, mm: asked_mm }) => near.filter((one) => one.label === label && one.mm < asked_mm).map(({ mm }) => ({ label, mm, asked_mm })))
    .sort((a, b) => a.mm - a.asked_mm - (b.mm - b.asked_mm));
}

/** TOML as a plan's file has it. What palpate does not tell of its own plan (its title, regions, `enters`) is not in it. */
export function planText({ trajectories, keep_away }: Plan, title: string): string {
  // what JSON spells out TOML spells out, too
  const list = (p: Vec3): string => `[${p.map((x) => String(x === 0 ? 0 : x)).join(", ")}]`;
  const bounds = { entry_within: "entry_within_mm", target_within: "target_within_mm", angle_within: "angle_within_deg", depth_within: "depth_within_mm" } as const;
  return [`title = ${JSON.stringify(title)}`,
    ...trajectories.map((one) => ["", "[[trajectory]]", `name = ${JSON.stringify(one.name)}`, `entry = ${list(one.entry_mm)}`, `target = ${list(one.target_mm)}`,
      ...Object.entries(bounds).flatMap(([key, own]) => (one[own] === null ? [] : [`${key} = ${one[own]}`]))].join("\n")),
    ...keep_away.map(({ label, mm }) => `\n[[keep_away]]\nstructures = [${label}]\ndistance = ${mm}`), ""].join("\n");
}
