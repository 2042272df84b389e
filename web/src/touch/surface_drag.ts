// Stroke: the path of the tip over surfaces while a press is dragged. The tip stays on the surface under the cursor,
// where palpate presses with the chosen force; over gaps and edges it is lifted and put down again. Where no short path
// is free, and where a contact is held back, the tip is set down in front of the surface without a path to it.

import { add, dot, length, normalize, scale, sub, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";
import { firstTouchable, type IsTouchable } from "./surface.js";
import { MAX_DISTANCE_MM, type PathPoint } from "../state/pointer.js";

/** Point on a surface; patient frame. */
export interface SurfacePoint {
  at: Vec3;
  into: Vec3; // unit direction into the structure
  from: Vec3; // unit direction of approach: the viewing direction
}

/** Distances from a cursor in a section within which an outline is touched: inside of the structure, and outside. */
const INSIDE_TOLERANCE_MM = 2.5,
  OUTSIDE_TOLERANCE_MM = 1;
/** Maximum distance between successive points of a path over a surface, unless the surface has a gap there. */
const STEP_MM = 1.5;
/** Maximum distance of successive cursor positions that are tested; pixels. */
const DRAG_PIXELS = 8;
/** Maximum depth of the bisection of a gap. */
const HALVINGS = 4;
/** Component of a direction along a surface below which a key does not stroke over it. */
const MIN_TANGENTIAL = 0.3;
/** Time for which the contact may lag more than MAX_DISTANCE_MM behind its target before the tip is set down. */
const MAX_LAG_MS = 150;
/**
 * The same for a contact that is beside the tip, at a distance of more than HELD_MM and HELD_FRACTION of the depth: a
 * ridge or a crease holds it back while the tip has passed, and it will not come.
 */
const MAX_HELD_MS = 25,
  HELD_MM = 2,
  HELD_FRACTION = 0.6;
/**
 * Cosine of the angle between two directions into a structure below which they belong to different sides of it. A press
 * has gone through a thin structure if the contact faces along it.
 */
const OTHER_SIDE = -0.3;
/**
 * Maximum distance between two picks that are connected along the surface: a surface that is seen edge-on has distant
 * points under neighbouring pixels.
 */
const EDGE_ON_MM = 12;

/** Component of a dented surface's normal against the direction of the press. */
const LEAST_FACING = 0.7;
/** Maximum depth to which palpate presses (PointerDriver::kMaxDepth_mm). */
const MAX_DENT_MM = 15;

/** Distance in front of a surface from which the tip approaches it, and where a contact that was held back is freed. */
const OUTSIDE_MM = 3,
  FREED_MM = 1.5;
/** Path length within which the tip may leave its current contact. */
const LEAVES_MM = 5;
/** Candidate detours towards the viewer. */
const DETOUR_HEIGHTS_MM = [0, 3, 6, 12];
/** Maximum length of a detour. */
const MAX_DETOUR_MM = 60;

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
 * Unit direction into the structures at a point of their surface: mean of the directions towards touchable voxels.
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

/** Contact of a tool: its position, and the unit normal of the surface, outward. */
export interface ContactPoint {
  at: Vec3;
  normal: Vec3;
  isRigid?: boolean; // no tissue yields: a contact below the surface is on another one
}

/** Distance of a contact from a target, without the depth of the dent that it presses into soft tissue. */
export function distanceFrom({ at, into }: PathPoint, contact: ContactPoint): number {
  const away = sub(contact.at, at);
  // beside a surface nothing is dented
  if (!into || contact.isRigid || dot(contact.normal, into) > -LEAST_FACING) return length(away);
  const dent_mm = Math.min(Math.max(0, dot(away, into)), MAX_DENT_MM);
  return length(sub(away, scale(into, dent_mm)));
}

/** Whether a contact is beside the tip that presses into a surface, instead of above it. */
export function isHeldBack(tip: Vec3, into: Vec3, contact: Vec3): boolean {
  const away = sub(contact, tip);
  const depth_mm = -dot(away, into);
  return length(add(away, scale(into, depth_mm))) > Math.max(HELD_MM, HELD_FRACTION * depth_mm);
}

/**
 * Position of a tip in front of a surface, free of contact; null: there is none.
 * @param off_mm  distance from the surface, less in a gap
 */
function inFrontOf(isTouchable: IsTouchable, surface: Vec3, into: Vec3, off_mm = OUTSIDE_MM): Vec3 | null {
  for (; off_mm > 0.25; off_mm /= 2) {
    const p = sub(surface, scale(into, off_mm));
    if (!isTouchable(p)) return p;
  }
  return null;
}

/**
 * Path of the tip to a position in front of a surface: waypoints, between which it is free of contact. Without a short
 * one, the tip is set down there.
 * @param isBlocked  whether the tool would touch anything at a position of its tip
 */
export function pathTo(isBlocked: IsTouchable, tip: Vec3, surface: Vec3, into: Vec3, step_mm: number): PathPoint[] {
  const outside = inFrontOf(isBlocked, surface, into) ?? sub(surface, scale(into, OUTSIDE_MM));
  // leaves_mm: initial path length within which the tip may be in contact
  const isFree = (a: Vec3, b: Vec3, leaves_mm = 0) => {
    const far = length(sub(b, a));
    let hasLeft = false;
    for (let distance_mm = 0; distance_mm < far; distance_mm += step_mm) {
      const felt = isBlocked(add(a, scale(sub(b, a), distance_mm / far)));
      hasLeft ||= !felt;
      if (felt && (hasLeft || distance_mm > leaves_mm)) return false;
    }
    return true;
  };
  const through = (path: Vec3[]) => path.map((at) => ({ at, into: null }));
  if (isFree(tip, outside, LEAVES_MM)) return through([outside]);
  // detours on the viewer's side, because the proxy would stay on the near side of an obstacle
  const least = Math.min(dot(tip, into), dot(outside, into));
  const lifted = (p: Vec3, lift: number) => sub(p, scale(into, dot(p, into) - least + lift));
  for (const lift of DETOUR_HEIGHTS_MM) {
    const [a, b] = [lifted(tip, lift), lifted(outside, lift)];
    const mm = length(sub(a, tip)) + length(sub(b, a)) + length(sub(outside, b));
    if (mm <= MAX_DETOUR_MM && isFree(tip, a, LEAVES_MM) && isFree(a, b) && isFree(b, outside))
      return through([a, b, outside]);
  }
  return [{ at: outside, into: null, isSetDown: true }];
}

/** Finds the surface at a position along the cursor's movement, from 0, its begin, to 1; null: none. */
export type Pick = (fraction: number) => SurfacePoint | null;

export class SurfaceDrag {
  /** Surface point that the tip presses on, or is on its way to; null: it is lifted. */
  point: SurfacePoint | null = null;
  /**
   * Whether the contact is not where the cursor shows, in the latest pose or by a path that has been added since: the
   * tip is on its way to the surface under the cursor. False while the cursor is on no surface.
   */
  isTransferring = false;
  private end: Vec3; // end of the path so far
  private readonly rim: Vec3[]; // offsets from the tip's centre at which its surface is tested
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
    // a tip within a voxel touches what its centre does
    this.rim = radius_mm > volumes.voxelSize / 2 ? SPHERE.map((direction) => scale(direction, 0.9 * radius_mm)) : [];
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
    const max_mm = isInside ? INSIDE_TOLERANCE_MM : OUTSIDE_TOLERANCE_MM;
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
    return length(along) < MIN_TANGENTIAL ? [0, 0, 0] : normalize(along);
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
    const { end: before } = this;
    for (let n = 1; n <= parts; n++)
      steps.push(...this.refine(pick, (n - 1) / parts, n / parts, pick(n / parts), HALVINGS));
    // known before the next pose comes
    const isLong = steps.some(({ into }) => !into) || length(sub(this.end, before)) > MAX_DISTANCE_MM;
    this.isTransferring = this.point !== null && (this.isTransferring || isLong);
    return steps;
  }
  /** Follows the surface between two cursor positions, or leaves it where it ends. */
  private refine(pick: Pick, from: number, to: number, point: SurfacePoint | null, halvings: number): PathPoint[] {
    const { point: last } = this;
    const isNear = last !== null && point !== null && length(sub(point.at, last.at)) <= STEP_MM;
    // nothing leads over the edge of a thin structure to its other side
    if (isNear && dot(point.into, last.into) < OTHER_SIDE) return this.moveTo(point, to);
    if (isNear) return this.slide(point);
    if (!last && !point) return this.moveTo(null, to);
    if (halvings === 0) {
      if (!last || !point) return this.moveTo(point, to);
      // over a ledge no higher than what a contact may be from the cursor, the force goes on
      const isLow = length(sub(point.at, last.at)) <= MAX_DISTANCE_MM && dot(point.into, last.into) >= OTHER_SIDE;
      return this.slideAlong(last, point) ?? (isLow ? this.slide(point) : this.moveTo(point, to));
    }
    const middle = (from + to) / 2;
    return [
      ...this.refine(pick, from, middle, pick(middle), halvings - 1),
      ...this.refine(pick, middle, to, point, halvings - 1),
    ];
  }

  /** Path over the surface between two of its points; null: they are not connected, or too far apart. */
  private slideAlong(from: SurfacePoint, to: SurfacePoint): PathPoint[] | null {
    const far_mm = length(sub(to.at, from.at));
    if (far_mm > EDGE_ON_MM) return null;
    const step_mm = this.volumes.voxelSize / 4;
    const parts = Math.ceil((2 * far_mm) / STEP_MM);
    const points: SurfacePoint[] = [];
    let last = from.at;
    for (let n = 1; n < parts; n++) {
      const fraction = n / parts;
      const into = normalize(add(scale(from.into, 1 - fraction), scale(to.into, fraction)));
      const at = add(from.at, scale(sub(to.at, from.at), fraction));
      // the surface nearest to the height of the previous point
      const p = add(at, scale(into, dot(sub(last, at), into)));
      const isInside = this.isTouchable(p);
      let depth_mm = 0;
      while (this.isTouchable(add(p, scale(into, depth_mm))) === isInside) {
        depth_mm += isInside ? -step_mm : step_mm;
        if (Math.abs(depth_mm) > STEP_MM) return null;
      }
      last = add(p, scale(into, depth_mm));
      points.push({
        at: last,
        into: inward(this.isTouchable, last, this.volumes.voxelSize, SPHERE, into),
        from: to.from,
      });
    }
    if (length(sub(to.at, last)) > 2 * STEP_MM) return null;
    return [...points, to].flatMap((point) => this.slide(point));
  }
  private slide(point: SurfacePoint): PathPoint[] {
    this.point = point;
    this.end = sub(point.at, scale(point.into, this.radius_mm));
    return [{ at: this.end, into: point.into }];
  }
  /** Lifts the tip, and puts it down again on a surface, if there is one. */
  private moveTo(point: SurfacePoint | null, fraction: number): PathPoint[] {
    const steps: PathPoint[] = [];
    const addStep = (step: PathPoint) => {
      this.end = step.at;
      steps.push(step);
    };
    if (this.point) addStep({ at: this.outside(this.point), into: null });
    this.point = null;
    if (point) {
      const path = pathTo(this.isBlocked, this.end, this.centreAt(point), point.from, this.volumes.voxelSize / 2);
      path.forEach(addStep);
      return [...steps, ...this.slide(point)];
    }
    const hover = this.hover(fraction, this.end);
    if (length(sub(hover, this.end)) > 1e-3 && this.isFree(hover)) addStep({ at: hover, into: null });
    return steps;
  }
  /** Centre of the tool's tip in contact with a surface point. */
  private centreAt({ at, into }: SurfacePoint): Vec3 {
    return sub(at, scale(into, this.radius_mm));
  }
  /** Position in front of a surface point. */
  private outside(point: SurfacePoint, off_mm = OUTSIDE_MM): Vec3 {
    const centre = this.centreAt(point);
    const inFront = (into: Vec3) => inFrontOf(this.isBlocked, centre, into, off_mm);
    return inFront(point.into) ?? inFront(point.from) ?? point.at;
  }
  /** Whether the tool would touch anything at a position of its tip. */
  private readonly isBlocked = (p: Vec3): boolean =>
    this.isTouchable(p) || this.rim.some((offset) => this.isTouchable(add(p, offset)));
  /** Whether the straight path to a position is free of contact. */
  private isFree(to: Vec3): boolean {
    const path = sub(to, this.end);
    const parts = Math.ceil(length(path) / this.volumes.voxelSize);
    return Array.from({ length: parts }, (_, n) => (n + 1) / parts).every(
      (fraction) => !this.isBlocked(add(this.end, scale(path, fraction))),
    );
  }

  /**
   * Path of a tip that is set down again, because something holds its contact back, or because the contact was reset
   * inside of a structure. It replaces the remaining path.
   * @param target  position that the tip has been sent to
   * @param contact  null: no contact
   * @param tip  position of the tip in the same pose as the contact
   * @param isInside  contact was reset while the tip was inside, as after a halt of the loop: there is no force
   * @returns null: the contact is where it should be, or has just begun to lag
   */
  freed(
    now_ms: number,
    target: PathPoint,
    contact: ContactPoint | null,
    tip: Vec3,
    isInside = false,
  ): PathPoint[] | null {
    const { end, point } = this;
    this.isTransferring =
      point !== null && !(contact && distanceFrom({ at: end, into: point.into }, contact) <= MAX_DISTANCE_MM);
    const isFar = contact !== null && distanceFrom(target, contact) > MAX_DISTANCE_MM;
    const isOpposite = contact !== null && target.into !== null && -dot(contact.normal, target.into) < OTHER_SIDE;
    const isAway = isFar || isOpposite || (isInside && target.into !== null);
    if (!isAway) this.away_ms = NaN;
    else if (Number.isNaN(this.away_ms)) this.away_ms = now_ms;
    const isHeld =
      isInside || isOpposite || (contact !== null && target.into !== null && isHeldBack(tip, target.into, contact.at));
    if (!(now_ms - this.away_ms > (isHeld ? MAX_HELD_MS : MAX_LAG_MS))) return null;
    this.away_ms = NaN;
    if (!point) return [{ at: this.end, into: null, isSetDown: true }];
    const off_mm = isInside ? OUTSIDE_MM : FREED_MM;
    return [{ at: this.outside(point, off_mm), into: null, isSetDown: true }, ...this.slide(point)];
  }
}
