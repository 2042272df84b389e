// Picking of surfaces with contact forces along a ray, and the height above them.

import { add, apply, column, length, scale, sub, turn, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";

/** Predicate: whether contact forces act at a position, patient frame. */
export type IsTouchable = (p: Vec3) => boolean;

/** Interval, mm, of a line within the bounding box of a volume: begin and end; empty if end < begin. */
function within(volumes: Volumes, from: Vec3, into: Vec3): [number, number] {
  const [at, by] = [apply(volumes.voxelFromPatient, from), turn(volumes.voxelFromPatient, into)];
  let [begin, end] = [-Infinity, Infinity];
  for (const axis of [0, 1, 2]) {
    const ends = [-0.5, volumes.dims[axis]! - 0.5].map((side) => (side - at[axis]!) / (by[axis]! || 1e-12));
    begin = Math.max(begin, Math.min(...ends));
    end = Math.min(end, Math.max(...ends));
  }
  return [begin, end];
}

/**
 * First position with contact forces along a line; null: none.
 * @param min_mm  start of the search, distance from `from` along `into`
 */
export function firstTouchable(
  volumes: Volumes,
  isTouchable: IsTouchable,
  from: Vec3,
  into: Vec3,
  min_mm = -Infinity,
): Vec3 | null {
  const [begin, end] = within(volumes, from, into);
  const step = volumes.voxelSize / 3;
  const at = (distance_mm: number) => add(from, scale(into, distance_mm));
  for (let distance_mm = Math.max(begin, min_mm); distance_mm < end; distance_mm += step) {
    if (!isTouchable(at(distance_mm))) continue;
    let [outside, inside] = [distance_mm - step, distance_mm];
    for (let n = 0; n < 6; n++) {
      const middle = (outside + inside) / 2;
      if (isTouchable(at(middle))) inside = middle;
      else outside = middle;
    }
    return at(inside);
  }
  return null;
}

/** Height above the nearest surface with contact below a position. */
export class SurfaceBelowTool {
  private readonly steps: { offset: Vec3; far_mm: number }[] = []; // offsets of sampled voxels, nearest first
  private readonly stride: number; // spacing of offsets, voxels
  // cache of `below` by device number
  private readonly ofTools = new Map<number, { at: string; found: ReturnType<SurfaceBelowTool["below"]> }>();

  constructor(
    private readonly volumes: Volumes,
    max_mm: number,
    maxSteps = 40000,
  ) {
    const edges = [0, 1, 2].map((axis) => column(volumes.patientFromVoxel, axis));
    const lengths = edges.map(length);
    const all = lengths.reduce((product, edge) => (product * 2 * max_mm) / edge, 1);
    const stride = (this.stride = Math.max(1, Math.ceil(Math.cbrt(all / maxSteps))));
    const [ni, nj, nk] = lengths.map((edge) => Math.floor(max_mm / edge / stride)) as Vec3;
    for (let k = -nk; k <= nk; k++)
      for (let j = -nj; j <= nj; j++)
        for (let i = -ni; i <= ni; i++) {
          const offset = [0, 1, 2].map(
            (c) => stride * (i * edges[0]![c]! + j * edges[1]![c]! + k * edges[2]![c]!),
          ) as Vec3;
          if (length(offset) <= max_mm) this.steps.push({ offset, far_mm: length(offset) });
        }
    this.steps.sort((a, b) => a.far_mm - b.far_mm);
  }

  /** Result of `below`, cached per device until the tool moves, because it may take as long as a frame. */
  belowTool(number: number, p: Vec3, isTouchable: IsTouchable): ReturnType<SurfaceBelowTool["below"]> {
    const at = p.join();
    if (this.ofTools.get(number)?.at !== at) this.ofTools.set(number, { at, found: this.below(p, isTouchable) });
    return this.ofTools.get(number)!.found;
  }
  /** Invalidates the cache after a change of voxels. */
  forget(): void {
    this.ofTools.clear();
  }

  below(p: Vec3, isTouchable: IsTouchable): { foot: Vec3; height_mm: number } | null {
    const { volumes } = this;
    // starts at the voxel's centre, so that offsets end at centres of voxels
    const middle = apply(volumes.patientFromVoxel, apply(volumes.voxelFromPatient, p).map(Math.round) as Vec3);
    const met = this.steps.find(({ offset }) => isTouchable(add(middle, offset)));
    if (!met) return null;
    // refines the hit among the voxels that the stride has skipped
    let towards = sub(add(middle, met.offset), p);
    const size = 2 * this.stride - 1;
    for (let n = 0; n < size ** 3; n++) {
      const by = [n % size, Math.floor(n / size) % size, Math.floor(n / size ** 2)].map(
        (x) => x - this.stride + 1,
      ) as Vec3;
      const other = sub(add(add(middle, met.offset), turn(volumes.patientFromVoxel, by)), p);
      if (length(other) < length(towards) && isTouchable(add(p, other))) towards = other;
    }
    const height_mm = length(towards) - volumes.voxelSize / 2;
    return height_mm > 0 ? { foot: add(p, scale(towards, height_mm / length(towards))), height_mm } : null;
  }
}
