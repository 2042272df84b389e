// Stroke: the path of the tip over surfaces while a press is dragged. The tip stays on the surface under the cursor,
// where palpate presses with the chosen force; over gaps and edges it is lifted and put down again.

import { add, dot, length, normalize, scale, sub, tangents, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";
import { firstTouchable, type IsTouchable } from "./surface.js";
import { MAX_DISTANCE_MM, type PathPoint } from "../state/pointer.js";

/** Point on a surface; patient frame. */
export interface SurfacePoint {
  at: Vec3;
  into: Vec3; // unit direction into the structure
  from: Vec3; // unit direction in which the tip comes to it: that of the view
}

/** Distances from a cursor in a section within which an outline is touched: inside of the structure, and outside. */
const INSIDE_MM = 2.5,
  BESIDE_MM = 1;
/** Maximum distance between successive points of a path over a surface, unless the surface has a gap there. */
const STEP_MM = 1.5;
/** Maximum distance of successive cursor positions that are tested; pixels. */
const DRAG_PIXELS = 8;
/** Maximum depth of the bisection of a gap. */
const HALVINGS = 4;
/** Component of a direction along a surface below which a key does not stroke over it. */
const LEAST_ALONG = 0.3;
/** Time for which the contact may be farther than MAX_DISTANCE_MM from its target, while it follows. */
const CAUGHT_MS = 150;

/** Distance in front of a surface from which the tip approaches it. */
const OUTSIDE_MM = 3;
/** Path length within which the tip may leave its current contact. */
const LEAVES_MM = 5;
/** Candidate detours towards the viewer, after candidate displacements sideways for a tip below an obstacle. */
const LIFTS_MM = [0, 3, 6, 12, 25, 50, 100, 200];
const ASIDE_MM = [0, 6, 12, 25, 50];
const SIDES = 8;

const SPHERE: Vec3[] = Array.from(
  { length: 27 },
  (_, n) => [(n % 3) - 1, (Math.floor(n / 3) % 3) - 1, Math.floor(n / 9) - 1] as Vec3,
)
  .filter((v) => length(v) > 0)
  .map(normalize);
const CIRCLE: [number, number][] = Array.from({ length: 24 }, (_, n) => [
  Math.cos((n * Math.PI) / 12),
  Math.sin((n * Math.PI) / 12),
]);

/**
 * Unit direction into the structures at a point of their surface: mean of the directions in which they are felt.
 * @param directions  unit directions to sample
 * @param fallback  unit direction for a point without a preferred side, as of a thin sheet
 */
function inward(isTouchable: IsTouchable, at: Vec3, voxel_mm: number, directions: Vec3[], fallback: Vec3): Vec3 {
  let sum: Vec3 = [0, 0, 0];
  for (const far_mm of [1.2 * voxel_mm, 2.4 * voxel_mm])
    for (const direction of directions)
      sum = add(sum, scale(direction, isTouchable(add(at, scale(direction, far_mm))) ? 1 : -1));
  if (length(sum) < 0.05 * directions.length) return fallback;
  return normalize(sum);
}

/** Position of a tip in front of a surface, free of contact: closer to it in a gap; null: there is none. */
function inFrontOf(isTouchable: IsTouchable, surface: Vec3, into: Vec3): Vec3 | null {
  for (let off_mm = OUTSIDE_MM; off_mm > 0.25; off_mm /= 2) {
    const p = sub(surface, scale(into, off_mm));
    if (!isTouchable(p)) return p;
  }
  return null;
}

/** Path of the tip, free of contact, to a position in front of a surface: waypoints. */
export function pathTo(isTouchable: IsTouchable, tip: Vec3, surface: Vec3, into: Vec3, step_mm: number): Vec3[] {
  const outside = inFrontOf(isTouchable, surface, into) ?? sub(surface, scale(into, OUTSIDE_MM));
  // leaves_mm: initial path length within which the tip may be in contact
  const isFree = (a: Vec3, b: Vec3, leaves_mm = 0) => {
    const far = length(sub(b, a));
    let hasLeft = false;
    for (let distance_mm = 0; distance_mm < far; distance_mm += step_mm) {
      const felt = isTouchable(add(a, scale(sub(b, a), distance_mm / far)));
      hasLeft ||= !felt;
      if (felt && (hasLeft || distance_mm > leaves_mm)) return false;
    }
    return true;
  };
  if (isFree(tip, outside, LEAVES_MM)) return [outside];
  // detours on the viewer's side, because the proxy would stay on the near side of an obstacle
  const [first, second] = tangents(into);
  const least = Math.min(dot(tip, into), dot(outside, into));
  const lifted = (p: Vec3, lift: number) => sub(p, scale(into, dot(p, into) - least + lift));
  for (const aside of ASIDE_MM) {
    for (let side = 0; side < (aside > 0 ? SIDES : 1); side++) {
      const angle = (2 * Math.PI * side) / SIDES;
      const beside = add(tip, add(scale(first, aside * Math.cos(angle)), scale(second, aside * Math.sin(angle))));
      if (!isFree(tip, beside, LEAVES_MM)) continue;
      for (const lift of LIFTS_MM) {
        const [a, b] = [lifted(beside, lift), lifted(outside, lift)];
        if (isFree(beside, a, aside > 0 ? 0 : LEAVES_MM) && isFree(a, b) && isFree(b, outside))
          return [beside, a, b, outside];
      }
    }
  }
  const far = LIFTS_MM.at(-1)!;
  return [lifted(tip, far), lifted(outside, far), outside];
}

/** Finds the surface at a position along the cursor's movement, from 0, its begin, to 1; null: none. */
export type Pick = (fraction: number) => SurfacePoint | null;

export class Stroke {
  /** Surface point that the tip presses on, or is on its way to; null: it is lifted. */
  point: SurfacePoint | null = null;
  private end: Vec3; // end of the path so far
  private away_ms = NaN; // time since which the contact is too far from its target; NaN: it is not

  /**
   * @param tip  position of the tip at the press
   * @param radius_mm  radius of the tool's tip, whose centre stays outside of the surface
   * @param hover  position without force for a cursor on no surface, given the end of the path so far
   */
  constructor(
    private readonly volumes: Volumes,
    private readonly isTouchable: IsTouchable,
    tip: Vec3,
    private readonly radius_mm: number,
    private readonly hover: (fraction: number, end: Vec3) => Vec3,
  ) {
    this.end = tip;
  }

  /**
   * First surface along a ray; null: none.
   * @param isSolid  solids along the ray
   * @param min_mm  start of the search, distance from `from` along `into`
   */
  surfaceAlong(
    { from, into }: { from: Vec3; into: Vec3 },
    isSolid: IsTouchable = this.isTouchable,
    min_mm = -Infinity,
  ): SurfacePoint | null {
    const at = firstTouchable(this.volumes, isSolid, from, into, min_mm);
    if (!at) return null;
    const inwards = inward(isSolid, at, this.volumes.voxelSize, SPHERE, into);
    // the side that faces the viewer, also where the surface is seen edge-on
    const facing = dot(inwards, into);
    return { at, into: facing > 0.1 ? inwards : normalize(add(inwards, scale(into, 0.2 - facing))), from: into };
  }

  /**
   * Point on an outline next to a position in a plane; null: none is near enough. The side of a thin structure on which
   * the contact is, is preferred.
   */
  outlineNear(p: Vec3, { right, down }: { right: Vec3; down: Vec3 }): SurfacePoint | null {
    const { volumes, isTouchable, point } = this;
    const isInside = isTouchable(p);
    const step_mm = volumes.voxelSize / 2;
    const directions = CIRCLE.map(([x, y]) => add(scale(right, x), scale(down, y)));
    const max_mm = isInside ? INSIDE_MM : BESIDE_MM;
    const found: { at: Vec3; direction: Vec3; cost: number }[] = [];
    for (const direction of directions) {
      let far = step_mm;
      while (far <= max_mm && isTouchable(add(p, scale(direction, far))) === isInside) far += step_mm;
      if (far > max_mm) continue;
      for (let [n, near] = [0, far - step_mm]; n < 5; n++) {
        const middle = (near + far) / 2;
        if (isTouchable(add(p, scale(direction, middle))) === isInside) near = middle;
        else far = middle;
      }
      const at = add(p, scale(direction, far));
      const jump_mm = point ? length(sub(at, point.at)) : 0;
      found.push({ at, direction: isInside ? scale(direction, -1) : direction, cost: far + jump_mm / 2 });
    }
    found.sort((a, b) => a.cost - b.cost);
    const points = found.slice(0, point ? 12 : 1).map(({ at, direction }) => {
      // the surface's own normal: a press along the plane slides on a surface that the plane cuts at an angle
      const into = inward(isTouchable, at, volumes.voxelSize, SPHERE, direction);
      return { at, into, from: into };
    });
    return points.find(({ into }) => !point || dot(into, point.into) > 0.2) ?? points[0] ?? null;
  }

  /** Unit direction along the surface in contact that is nearest to a direction; 0 across the surface. */
  along(direction: Vec3): Vec3 {
    if (!this.point) return direction;
    const along = sub(direction, scale(this.point.into, dot(direction, this.point.into)));
    return length(along) < LEAST_ALONG ? [0, 0, 0] : normalize(along);
  }

  /** Path of the tip to a press. */
  begin(pick: Pick): PathPoint[] {
    return this.moveTo(pick(1), 1);
  }

  /**
   * Path of the tip for a movement of the cursor.
   * @param pixels  length of the movement
   */
  follow(pick: Pick, pixels: number): PathPoint[] {
    const parts = Math.max(1, Math.ceil(pixels / DRAG_PIXELS));
    const steps: PathPoint[] = [];
    for (let n = 1; n <= parts; n++)
      steps.push(...this.refine(pick, (n - 1) / parts, n / parts, pick(n / parts), HALVINGS));
    return steps;
  }
  /** Follows the surface between two cursor positions, or leaves it where it ends. */
  private refine(pick: Pick, from: number, to: number, point: SurfacePoint | null, halvings: number): PathPoint[] {
    const { point: last } = this;
    if (last && point && length(sub(point.at, last.at)) <= STEP_MM) return this.slide(point);
    if (!last && !point) return this.moveTo(null, to);
    if (halvings === 0) return this.moveTo(point, to);
    const middle = (from + to) / 2;
    return [
      ...this.refine(pick, from, middle, pick(middle), halvings - 1),
      ...this.refine(pick, middle, to, point, halvings - 1),
    ];
  }

  private slide(point: SurfacePoint): PathPoint[] {
    this.point = point;
    this.end = sub(point.at, scale(point.into, this.radius_mm));
    return [{ at: this.end, into: point.into }];
  }
  /** Lifts the tip, and puts it down again on a surface, if there is one. */
  private moveTo(point: SurfacePoint | null, fraction: number): PathPoint[] {
    const steps: PathPoint[] = [];
    const addStep = (at: Vec3) => steps.push({ at: (this.end = at), into: null });
    if (this.point) addStep(this.outside(this.point));
    this.point = null;
    if (point) {
      const centre = sub(point.at, scale(point.into, this.radius_mm));
      for (const at of pathTo(this.isTouchable, this.end, centre, point.from, this.volumes.voxelSize / 2)) addStep(at);
      return [...steps, ...this.slide(point)];
    }
    const hover = this.hover(fraction, this.end);
    if (length(sub(hover, this.end)) > 1e-3 && this.isFree(hover)) addStep(hover);
    return steps;
  }
  /** Position in front of a surface point. */
  private outside({ at, into }: SurfacePoint): Vec3 {
    return inFrontOf(this.isTouchable, sub(at, scale(into, this.radius_mm)), into) ?? at;
  }
  /** Whether the straight path to a position is free of contact. */
  private isFree(to: Vec3): boolean {
    const path = sub(to, this.end);
    const parts = Math.ceil(length(path) / this.volumes.voxelSize);
    return Array.from({ length: parts }, (_, n) => (n + 1) / parts).every(
      (fraction) => !this.isTouchable(add(this.end, scale(path, fraction))),
    );
  }

  /**
   * Path that frees a contact which something holds back from its target, or that was reset inside of a structure.
   * @param target  position that the tip has been sent to
   * @param contact  position of the tool in contact; null: no contact
   * @param isInside  contact was reset while the tip was inside, as after a halt of the loop: there is no force
   * @returns null: the contact is where it should be, or has just begun to lag
   */
  freed(now_ms: number, target: PathPoint, contact: Vec3 | null, isInside = false): PathPoint[] | null {
    const isFar = contact !== null && length(sub(contact, target.at)) > MAX_DISTANCE_MM;
    const isAway = target.into !== null && (isInside || isFar);
    if (!isAway) this.away_ms = NaN;
    else if (Number.isNaN(this.away_ms)) this.away_ms = now_ms;
    if (!(now_ms - this.away_ms > CAUGHT_MS) || !this.point) return null;
    this.away_ms = NaN;
    const { point } = this;
    this.point = { ...point, at: contact ?? point.at };
    return this.moveTo(point, 1);
  }
}
