// Deviation of a tool from a plan: trajectories from an entry to a target, and distances to keep. Patient frame, mm.

import type { DeviceTool, Plan, Trajectory } from "../protocol/messages.js";
import { add, angleAt_deg, dot, length, normalize, scale, sub, type Vec3 } from "../base/geometry.js";
import type { StructureDistance } from "../protocol/distances.js";

/** Deviation of a tip from a trajectory. */
export interface TrajectoryDeviation {
  lateral_mm: number; // distance from the trajectory's line
  left_mm: number; // remaining depth to the target, negative beyond it
  angle_deg: number | null; // angle between the trajectory and the shaft, from handle to tip; null: unknown
}
/** @param shaft  unit direction from tip to handle; null: no shaft, or unknown orientation */
export function deviationFrom({ entry_mm, target_mm }: Trajectory, tip: Vec3, shaft: Vec3 | null): TrajectoryDeviation {
  const axis = normalize(sub(target_mm, entry_mm));
  const left_mm = dot(sub(target_mm, tip), axis);
  const lateral_mm = length(sub(add(tip, scale(axis, left_mm)), target_mm));
  const angle_deg = shaft && angleAt_deg([0, 0, 0], scale(shaft, -1), axis);
  return { lateral_mm, left_mm, angle_deg };
}
/** Distance of a position from the segment between a trajectory's ends, mm. */
export function toTrajectory({ entry_mm, target_mm }: Trajectory, position: Vec3): number {
  const way = sub(target_mm, entry_mm);
  const fraction = Math.min(1, Math.max(0, dot(sub(position, entry_mm), way) / dot(way, way)));
  return length(sub(add(entry_mm, scale(way, fraction)), position));
}

/**
 * Unit direction of the shaft in the tool's frame, from tip to handle: axis of the longest capsule, because the head of
 * a cylindrical or conical burr is a capsule too. Null: no capsules.
 */
export function shaftOf({ capsules }: DeviceTool): Vec3 | null {
  const [longest] = capsules
    .map(({ from_mm, to_mm }) => (length(to_mm) >= length(from_mm) ? sub(to_mm, from_mm) : sub(from_mm, to_mm)))
    .sort((a, b) => length(b) - length(a));
  return longest && length(longest) > 0 ? normalize(longest) : null;
}

/** Structure whose distance to the tool is below the planned minimum. */
export interface Breach {
  label: number;
  mm: number;
  requested_mm: number;
}
/** Structures closer than planned, the largest deficit first. */
export function breachesOf({ keep_away }: Plan, near: StructureDistance[]): Breach[] {
  return keep_away
    .flatMap(({ label, mm: requested_mm }) =>
      near.filter((one) => one.label === label && one.mm < requested_mm).map(({ mm }) => ({ label, mm, requested_mm })),
    )
    .sort((a, b) => a.mm - a.requested_mm - (b.mm - b.requested_mm));
}

/** Plan file in TOML, without the parts that palpate does not report (title, regions, `enters`). */
export function planText({ trajectories, keep_away }: Plan, title: string): string {
  // TOML's escapes include those of JSON
  const list = (p: Vec3): string => `[${p.map((x) => String(x === 0 ? 0 : x)).join(", ")}]`;
  const bounds = {
    entry_within: "entry_within_mm",
    target_within: "target_within_mm",
    angle_within: "angle_within_deg",
    depth_within: "depth_within_mm",
  } as const;
  return [
    `title = ${JSON.stringify(title)}`,
    ...trajectories.map((one) =>
      [
        "",
        "[[trajectory]]",
        `name = ${JSON.stringify(one.name)}`,
        `entry = ${list(one.entry_mm)}`,
        `target = ${list(one.target_mm)}`,
        ...Object.entries(bounds).flatMap(([key, own]) => (one[own] === null ? [] : [`${key} = ${one[own]}`])),
      ].join("\n"),
    ),
    ...keep_away.map(({ label, mm }) => `\n[[keep_away]]\nstructures = [${label}]\ndistance = ${mm}`),
    "",
  ].join("\n");
}
