// What a burr took away: the sweeps that the session tells of become voxels that hold nothing.

import { apply, type Vec3 } from "./geometry.js";
import type { Volumes } from "./scene.js";

/** From where the burr's centre was first to where it went, patient, and its radius; mm. */
export type Sweep = [number, number, number, number, number, number, number];
export interface VoxelBox { lo: Vec3; size: Vec3 }

/** The voxels whose centres lie within a sweep's reach, and more. */
function around(volumes: Volumes, [ax, ay, az, bx, by, bz, radius]: Sweep): VoxelBox {
  const lo: Vec3 = [Infinity, Infinity, Infinity], hi: Vec3 = [-Infinity, -Infinity, -Infinity];
  for (const x of [Math.min(ax, bx) - radius, Math.max(ax, bx) + radius]) {
    for (const y of [Math.min(ay, by) - radius, Math.max(ay, by) + radius]) {
      for (const z of [Math.min(az, bz) - radius, Math.max(az, bz) + radius]) {
        apply(volumes.voxelFromPatient, [x, y, z]).forEach((v, axis) => {
          lo[axis] = Math.min(lo[axis]!, v);
          hi[axis] = Math.max(hi[axis]!, v);
        });
      }
    }
  }
  const first = lo.map((v) => Math.max(0, Math.ceil(v))) as Vec3;
  return { lo: first, size: hi.map((v, axis) => Math.max(0, Math.min(volumes.dims[axis]! - 1, Math.floor(v)) - first[axis]! + 1)) as Vec3 };
}

/** Squared, from a sweep's way. */
function squaredAside([ax, ay, az, bx, by, bz]: Sweep, [x, y, z]: Vec3): number {
  const along = [bx - ax, by - ay, bz - az] as const, from = [x - ax, y - ay, z - az] as const;
  const length = along[0] ** 2 + along[1] ** 2 + along[2] ** 2;
  const part = length > 0 ? Math.max(0, Math.min(1, (from[0] * along[0] + from[1] * along[1] + from[2] * along[2]) / length)) : 0;
  return (from[0] - part * along[0]) ** 2 + (from[1] - part * along[1]) ** 2 + (from[2] - part * along[2]) ** 2;
}

function joined(a: VoxelBox | null, b: VoxelBox): VoxelBox {
  if (!a) return b;
  const lo = a.lo.map((v, axis) => Math.min(v, b.lo[axis]!)) as Vec3;
  return { lo, size: lo.map((v, axis) => Math.max(a.lo[axis]! + a.size[axis]!, b.lo[axis]! + b.size[axis]!) - v) as Vec3 };
}

export class Cuts {
  private sweeps: Sweep[] = [];
  private same = 0; // the first so many are taken from the volumes, and still hold
  private volumes: Volumes | null = null;
  // the voxels that were taken, in the order in which they were: what is taken back is always the end of it
  private readonly at: number[] = [];
  private readonly was: number[] = [];
  private readonly before: number[] = []; // of each sweep that was taken: how many voxels were taken before it

  /** What was told from number `first` on is not any more, and `sweeps` come after the others. */
  tell(first: number, sweeps: readonly Sweep[]): void {
    // what comes in between is not known
    if (first > this.sweeps.length) return;
    this.sweeps.length = first;
    this.same = Math.min(this.same, first);
    this.sweeps.push(...sweeps);
  }
  /** Another connection: whoever is there tells of all that is cut. */
  beginAnew(): void {
    this.tell(0, []);
  }

  /** Brings volumes up to what has been told. @param isCut  whether it can be taken away, by place of the structure + 1 @return what has changed in them, if anything has */
  takeFrom(volumes: Volumes, isCut: readonly boolean[]): VoxelBox | null {
    if (volumes !== this.volumes) {
      this.volumes = volumes;
      this.same = 0;
      this.at.length = this.was.length = this.before.length = 0;
    }
    let box = this.putBack(volumes);
    for (; this.same < this.sweeps.length; this.same++) {
      this.before.push(this.at.length);
      const changed = this.take(volumes, this.sweeps[this.same]!, isCut);
      if (changed) box = joined(box, changed);
    }
    return box;
  }

  /** What was taken by sweeps that are not any more. No sweep that is left reaches any of it: it came first, and would have taken it. */
  private putBack(volumes: Volumes): VoxelBox | null {
    const { at, was, before } = this;
    const left = before[this.same] ?? at.length;
    before.length = this.same;
    if (left === at.length) return null;
    const [ni, nj] = volumes.dims;
    const lo: Vec3 = [Infinity, Infinity, Infinity], hi: Vec3 = [-Infinity, -Infinity, -Infinity];
    while (at.length > left) {
      const index = at.pop()!;
      volumes.structure[index] = was.pop()!;
      [index % ni, Math.floor(index / ni) % nj, Math.floor(index / (ni * nj))].forEach((v, axis) => {
        lo[axis] = Math.min(lo[axis]!, v);
        hi[axis] = Math.max(hi[axis]!, v);
      });
    }
    return { lo, size: hi.map((v, axis) => v - lo[axis]! + 1) as Vec3 };
  }

  private take(volumes: Volumes, sweep: Sweep, isCut: readonly boolean[]): VoxelBox | null {
    const box = around(volumes, sweep);
    const { lo, size } = box;
    let changes = false;
    for (let k = lo[2]; k < lo[2] + size[2]; k++) {
      for (let j = lo[1]; j < lo[1] + size[1]; j++) {
        for (let i = lo[0]; i < lo[0] + size[0]; i++) {
          const index = i + volumes.dims[0] * (j + volumes.dims[1] * k);
          const structure = volumes.structure[index]!;
          if (!isCut[structure] || squaredAside(sweep, apply(volumes.patientFromVoxel, [i, j, k])) >= sweep[6] ** 2) continue;
          this.at.push(index);
          this.was.push(structure);
          volumes.structure[index] = 0;
          changes = true;
        }
      }
    }
    return changes ? box : null;
  }
}
