// Distance of tools to the borders at which no-go regions begin to push. Distances to structures are reported by
// palpate; distances to planes and balls are computed here from the tool's geometry.

import type { DeviceTool, NoGo } from "../protocol/messages.js";
import { add, dot, length, scale, sub, type Vec3 } from "../base/geometry.js";
import type { DeviceDistances } from "../protocol/distances.js";

/** Part of a tool: balls along a line segment with linearly varying radius; patient frame, mm. */
export interface ToolPart {
  from: Vec3;
  to: Vec3;
  radii_mm: readonly [number, number];
}

/**
 * Contact points and capsules of a tool.
 * @param tip  position of the device, patient frame
 * @param toPatient  rotation of directions from the tool's frame into the patient's
 */
export function toolParts(
  { points_mm, radius_mm, capsules }: DeviceTool,
  tip: Vec3,
  toPatient: (v: Vec3) => Vec3,
): ToolPart[] {
  const at = (p: Vec3) => add(tip, toPatient(p));
  return [
    ...points_mm.map((p): ToolPart => ({ from: at(p), to: at(p), radii_mm: [radius_mm, radius_mm] })),
    ...capsules.map(({ from_mm, to_mm, ...of }): ToolPart => ({
      from: at(from_mm),
      to: at(to_mm),
      radii_mm: [of.radius_mm, of.end_radius_mm],
    })),
  ];
}

/** Number of iterations of the ternary search along a part. */
const CUTS = 30;
/** Distance from a part's surface to a position, mm. Distance minus radius has a single minimum along the part. */
function toPoint({ from, to, radii_mm: [first, last] }: ToolPart, position: Vec3): number {
  const gap = (t: number) => length(sub(add(from, scale(sub(to, from), t)), position)) - first - t * (last - first);
  let low = 0,
    high = 1;
  for (let n = 0; n < CUTS; n++) {
    const third = (high - low) / 3;
    if (gap(low + third) < gap(high - third)) high -= third;
    else low += third;
  }
  return Math.min(gap(0), gap(1), gap((low + high) / 2));
}
const toPlane = ({ from, to, radii_mm }: ToolPart, point: Vec3, outward: Vec3): number =>
  Math.min(dot(sub(from, point), outward) - radii_mm[0], dot(sub(to, point), outward) - radii_mm[1]);

/** Distance between the surfaces of tool and region, mm, negative inside; null: beyond the reported reach. */
function distanceOf({ label, plane, ball }: NoGo, parts: ToolPart[], near: DeviceDistances): number | null {
  if (plane) return Math.min(...parts.map((part) => toPlane(part, plane.point_mm, plane.outward)));
  if (ball) return Math.min(...parts.map((part) => toPoint(part, ball.centre_mm))) - ball.radius_mm;
  return near.structures.find((structure) => structure.label === label)?.mm ?? null;
}

export interface Approach {
  region: number; // index in the scene's list
  mm: number; // distance to the border, margin included; negative: penetration
  pushes: boolean;
}
/**
 * Region with the deepest penetration, or else the nearest one; null: no distance is known.
 * @param regions  null for each region that is concealed until it pushes
 */
export function nearestNoGo(regions: (NoGo | null)[], parts: ToolPart[], near: DeviceDistances): Approach | null {
  // a region that pushes is reported by palpate
  if (near.noGo >= 0) return near.noGo < regions.length ? { region: near.noGo, mm: -near.depth, pushes: true } : null;
  const all = regions.flatMap((region, index): Approach[] => {
    const away_mm = region && distanceOf(region, parts, near);
    return away_mm === null ? [] : [{ region: index, mm: Math.max(0, away_mm - region!.keep_away_mm), pushes: false }];
  });
  return all.sort((a, b) => a.mm - b.mm)[0] ?? null;
}
