// Removal of voxels by burr sweeps, and its undo.

import type { Sweep } from "../protocol/messages.js";
import { add, apply, cross, dot, length, scale, sub, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";

export interface VoxelBox {
  lo: Vec3;
  size: Vec3;
}

/** Bounding box, in voxels, of the voxels whose centres a sweep may reach. */
function boundsOf(
  volumes: Volumes,
  [ax, ay, az, bx, by, bz, begin, ex = 0, ey = 0, ez = 0, end = begin]: Sweep,
): VoxelBox {
  const lo: Vec3 = [Infinity, Infinity, Infinity],
    hi: Vec3 = [-Infinity, -Infinity, -Infinity];
  const radius = Math.max(begin, end);
  for (const x of [Math.min(ax, bx, ax + ex, bx + ex) - radius, Math.max(ax, bx, ax + ex, bx + ex) + radius]) {
    for (const y of [Math.min(ay, by, ay + ey, by + ey) - radius, Math.max(ay, by, ay + ey, by + ey) + radius]) {
      for (const z of [Math.min(az, bz, az + ez, bz + ez) - radius, Math.max(az, bz, az + ez, bz + ez) + radius]) {
        apply(volumes.voxelFromPatient, [x, y, z]).forEach((v, axis) => {
          lo[axis] = Math.min(lo[axis]!, v);
          hi[axis] = Math.max(hi[axis]!, v);
        });
      }
    }
  }
  const first = lo.map((v) => Math.max(0, Math.ceil(v))) as Vec3;
  return {
    lo: first,
    size: hi.map((v, axis) => Math.max(0, Math.min(volumes.dims[axis]! - 1, Math.floor(v)) - first[axis]! + 1)) as Vec3,
  };
}

const within01 = (x: number): number => Math.max(0, Math.min(1, x));

/** Squared distance of a position from a segment along `way`; `from`: position relative to the segment's beginning. */
function squaredDistanceToSegment(way: Vec3, from: Vec3): number {
  const length = way[0] ** 2 + way[1] ** 2 + way[2] ** 2;
  const part = length > 0 ? within01((from[0] * way[0] + from[1] * way[1] + from[2] * way[2]) / length) : 0;
  return (from[0] - part * way[0]) ** 2 + (from[1] - part * way[1]) ** 2 + (from[2] - part * way[2]) ** 2;
}

/** Predicate for positions inside a sweep, by the session's rule (derived in palpate/tissue/sweep.h). */
function insideTest(sweep: Sweep): (at: Vec3) => boolean {
  const [ax, ay, az, bx, by, bz, radius, ex, ey, ez, last] = sweep;
  const begin: Vec3 = [ax, ay, az],
    way: Vec3 = [bx - ax, by - ay, bz - az];
  if (ex === undefined || (ex === 0 && ey === 0 && ez === 0))
    return (at) => squaredDistanceToSegment(way, sub(at, begin)) < radius ** 2;

  // head: radius as a linear function of the position on its axis
  const axis: Vec3 = [ex, ey!, ez!],
    radiusChange = last! - radius,
    axis2 = dot(axis, axis),
    axisLength = Math.sqrt(axis2);
  const slope = radiusChange / axisLength,
    sine = Math.abs(slope) < 1 ? Math.sqrt(1 - slope * slope) : 0;
  const headDepth = (from: Vec3): number => {
    const foot = dot(from, axis) / axis2;
    const part =
      sine > 0
        ? within01(foot + (slope * length(sub(from, scale(axis, foot)))) / (sine * axisLength))
        : slope > 0
          ? 1
          : 0;
    return radius + radiusChange * part - length(sub(from, scale(axis, part)));
  };
  // swept parallelogram of path and axis: radius as a linear function, by its gradient
  const across = cross(way, axis),
    determinant = dot(across, across),
    way2 = dot(way, way),
    mixed = dot(way, axis);
  const isPlane = determinant > 1e-12 * way2 * axis2;
  const normal = isPlane ? scale(across, 1 / Math.sqrt(determinant)) : across;
  const offWay = isPlane ? sub(axis, scale(way, mixed / way2)) : axis;
  const gradient = scale(offWay, radiusChange / dot(offWay, offWay)),
    gradient2 = dot(gradient, gradient);
  const planeSine = Math.sqrt(1 - gradient2);
  return (at) => {
    const from = sub(at, begin);
    if (isPlane && gradient2 < 1) {
      const height = Math.abs(dot(from, normal));
      const best = add(from, scale(gradient, height / planeSine)),
        byWay = dot(best, way),
        byAxis = dot(best, axis);
      const s = byWay * axis2 - byAxis * mixed,
        t = byAxis * way2 - byWay * mixed;
      if (s >= 0 && s <= determinant && t >= 0 && t <= determinant)
        return radius + dot(gradient, from) - height * planeSine > 0;
    }
    return (
      squaredDistanceToSegment(way, from) < radius ** 2 ||
      squaredDistanceToSegment(way, sub(from, axis)) < last! ** 2 ||
      headDepth(from) > 0 ||
      headDepth(sub(from, way)) > 0
    );
  };
}

function joined(a: VoxelBox | null, b: VoxelBox): VoxelBox {
  if (!a) return b;
  const lo = a.lo.map((v, axis) => Math.min(v, b.lo[axis]!)) as Vec3;
  return {
    lo,
    size: lo.map((v, axis) => Math.max(a.lo[axis]! + a.size[axis]!, b.lo[axis]! + b.size[axis]!) - v) as Vec3,
  };
}

export class Cuts {
  private sweeps: Sweep[] = [];
  private appliedCount = 0; // number of leading sweeps that are applied to the volumes and still valid
  private volumes: Volumes | null = null;
  // indices and previous structures of removed voxels, in order of removal: a stack for undo
  private readonly removedIndices: number[] = [];
  private readonly removedStructures: number[] = [];
  private readonly stackSizes: number[] = []; // for each applied sweep: number of voxels removed before it

  /** Replaces all sweeps from number `first` on; ignored if earlier ones are missing. */
  receive(first: number, sweeps: readonly Sweep[]): void {
    if (first > this.sweeps.length) return;
    this.sweeps.length = first;
    this.appliedCount = Math.min(this.appliedCount, first);
    this.sweeps.push(...sweeps);
  }
  /** Discards all sweeps; each connection reports them again. */
  reset(): void {
    this.receive(0, []);
  }

  /**
   * Brings volumes up to date with the reported sweeps.
   * @param isCut  whether a structure can be removed, indexed by the structure's index + 1
   * @returns bounding box of the changed voxels; null: none
   */
  applyTo(volumes: Volumes, isCut: readonly boolean[]): VoxelBox | null {
    if (volumes !== this.volumes) {
      this.volumes = volumes;
      this.appliedCount = 0;
      this.removedIndices.length = this.removedStructures.length = this.stackSizes.length = 0;
    }
    let box = this.putBack(volumes);
    for (; this.appliedCount < this.sweeps.length; this.appliedCount++) {
      this.stackSizes.push(this.removedIndices.length);
      const changed = this.take(volumes, this.sweeps[this.appliedCount]!, isCut);
      if (changed) box = joined(box, changed);
    }
    return box;
  }

  /**
   * Restores voxels removed by undone sweeps. No remaining sweep contains them: it was applied earlier and would have
   * removed them.
   */
  private putBack(volumes: Volumes): VoxelBox | null {
    const { removedIndices, removedStructures, stackSizes } = this;
    const left = stackSizes[this.appliedCount] ?? removedIndices.length;
    stackSizes.length = this.appliedCount;
    if (left === removedIndices.length) return null;
    const [ni, nj] = volumes.dims;
    const lo: Vec3 = [Infinity, Infinity, Infinity],
      hi: Vec3 = [-Infinity, -Infinity, -Infinity];
    while (removedIndices.length > left) {
      const index = removedIndices.pop()!;
      volumes.structure[index] = removedStructures.pop()!;
      volumes.removed.delete(index);
      [index % ni, Math.floor(index / ni) % nj, Math.floor(index / (ni * nj))].forEach((v, axis) => {
        lo[axis] = Math.min(lo[axis]!, v);
        hi[axis] = Math.max(hi[axis]!, v);
      });
    }
    return { lo, size: hi.map((v, axis) => v - lo[axis]! + 1) as Vec3 };
  }

  private take(volumes: Volumes, sweep: Sweep, isCut: readonly boolean[]): VoxelBox | null {
    const box = boundsOf(volumes, sweep);
    const { lo, size } = box,
      isSwept = insideTest(sweep);
    let changes = false;
    for (let k = lo[2]; k < lo[2] + size[2]; k++) {
      for (let j = lo[1]; j < lo[1] + size[1]; j++) {
        for (let i = lo[0]; i < lo[0] + size[0]; i++) {
          const index = i + volumes.dims[0] * (j + volumes.dims[1] * k);
          const structure = volumes.structure[index]!;
          if (!isCut[structure] || !isSwept(apply(volumes.patientFromVoxel, [i, j, k]))) continue;
          this.removedIndices.push(index);
          this.removedStructures.push(structure);
          volumes.structure[index] = 0;
          volumes.removed.add(index);
          changes = true;
        }
      }
    }
    return changes ? box : null;
  }
}
