// Distance of tools to the borders at which no-go regions begin to push. palpate reports the distance to structures;
// that to planes and balls is computed from the tool's geometry.

import type { HeldTool, NoGo } from "../protocol/messages.js";
import { add, dot, length, scale, sub, type Vec3 } from "../base/geometry.js";
import type { Near } from "../protocol/near.js";

/** Part of a tool's surface: balls along a line segment with linearly varying radius; patient frame. */
export interface ToolPart {
  from: Vec3;
  to: Vec3;
  radii_mm: readonly [number, number];
}

/**
 * @param tip  position of the device
 * @param toPatient  rotates directions from the tool's frame
 */
export function toolParts(
  { points_mm, radius_mm, capsules }: HeldTool,
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

/** Iterations of the ternary search along a part. */
const CUTS = 30;
/** Distance from a part's surface to a position: along the part, distance minus radius has a single minimum. */
function toPlace({ from, to, radii_mm: [first, last] }: ToolPart, place: Vec3): number {
  const gap = (t: number) => length(sub(add(from, scale(sub(to, from), t)), place)) - first - t * (last - first);
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

/** Distance from the tool's surface to that of a region, mm, negative inside; null: not reported, because far away. */
function distanceOf({ label, plane, ball }: NoGo, parts: ToolPart[], near: Near): number | null {
  if (plane) return Math.min(...parts.map((part) => toPlane(part, plane.point_mm, plane.outward)));
  if (ball) return Math.min(...parts.map((part) => toPlace(part, ball.centre_mm))) - ball.radius_mm;
  return near.structures.find((structure) => structure.label === label)?.mm ?? null;
}

export interface Approach {
  region: number; // index in the scene's list
  mm: number; // distance to the border; negative: penetration depth
  pushes: boolean;
}
/**
 * The region with the deepest penetration, or else the nearest one; null: none nearby.
 * @param regions  null for regions that are concealed until they push
 */
export function nearestNoGo(regions: (NoGo | null)[], parts: ToolPart[], near: Near): Approach | null {
  // palpate reports regions that push
  if (near.noGo >= 0) return near.noGo < regions.length ? { region: near.noGo, mm: -near.depth, pushes: true } : null;
  const all = regions.flatMap((region, place): Approach[] => {
    const away_mm = region && distanceOf(region, parts, near);
    return away_mm === null ? [] : [{ region: place, mm: Math.max(0, away_mm - region!.keep_away_mm), pushes: false }];
  });
  return all.sort((a, b) => a.mm - b.mm)[0] ?? null;
}
