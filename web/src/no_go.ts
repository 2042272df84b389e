// How near a tool is to where no-go regions begin to push it. Of structures palpate tells the distance; that of planes and balls follows
// from where the tool's outline is.

import { add, dot, length, scale, sub, type Vec3 } from "./geometry.js";
import type { Near } from "./near.js";
import type { HeldTool, NoGo } from "./scene.js";

/** A part of a tool's outline: all balls from one to another, whose radius changes evenly; patient. */
export interface ToolPart { from: Vec3; to: Vec3; radii_mm: readonly [number, number] }

/** @param tip  where the hand holds it. @param toPatient  turns directions from the tool's own frame */
export function toolParts({ points_mm, radius_mm, capsules }: HeldTool, tip: Vec3, toPatient: (v: Vec3) => Vec3): ToolPart[] {
  const at = (p: Vec3) => add(tip, toPatient(p));
  return [
    ...points_mm.map((p): ToolPart => ({ from: at(p), to: at(p), radii_mm: [radius_mm, radius_mm] })),
    ...capsules.map(({ from_mm, to_mm, ...of }): ToolPart => ({ from: at(from_mm), to: at(to_mm), radii_mm: [of.radius_mm, of.end_radius_mm] })),
  ];
}

/** So often what is left of a part is cut by a third where a place is looked for on it. */
const CUTS = 30;
/** From a part's outline to a place: each ball's distance less its radius has one least value along the part. */
function toPlace({ from, to, radii_mm: [first, last] }: ToolPart, place: Vec3): number {
  const gap = (t: number) => length(sub(add(from, scale(sub(to, from), t)), place)) - first - t * (last - first);
  let low = 0, high = 1;
  for (let n = 0; n < CUTS; n++) {
    const third = (high - low) / 3;
    if (gap(low + third) < gap(high - third)) high -= third;
    else low += third;
  }
  return Math.min(gap(0), gap(1), gap((low + high) / 2));
}
const toPlane = ({ from, to, radii_mm }: ToolPart, point: Vec3, outward: Vec3): number =>
  Math.min(dot(sub(from, point), outward) - radii_mm[0], dot(sub(to, point), outward) - radii_mm[1]);

/** From the tool's outline to a region's own surface, mm, below 0 inside. null: it is not told, for it is not near. */
function distanceOf({ label, plane, ball }: NoGo, parts: ToolPart[], near: Near): number | null {
  if (plane) return Math.min(...parts.map((part) => toPlane(part, plane.point_mm, plane.outward)));
  if (ball) return Math.min(...parts.map((part) => toPlace(part, ball.centre_mm))) - ball.radius_mm;
  return near.structures.find((structure) => structure.label === label)?.mm ?? null;
}

export interface Approach {
  region: number; // place in the scene's list
  mm: number; // to where it begins to push; below 0: so deep in it
  pushes: boolean;
}
/** The region that the tool is deepest in, or else comes nearest to; null: none is near. @param regions  null: not to be told before it pushes */
export function nearestNoGo(regions: (NoGo | null)[], parts: ToolPart[], near: Near): Approach | null {
  // what pushes palpate tells
  if (near.noGo >= 0) return near.noGo < regions.length ? { region: near.noGo, mm: -near.depth, pushes: true } : null;
  const all = regions.flatMap((region, place): Approach[] => {
    const away_mm = region && distanceOf(region, parts, near);
    return away_mm === null ? [] : [{ region: place, mm: Math.max(0, away_mm - region!.keep_away_mm), pushes: false }];
  });
  return all.sort((a, b) => a.mm - b.mm)[0] ?? null;
}
