// What a quiz keeps from the trainee: names, and the voxels of what is to be found, which look like what lies around them.

import type { Vec3 } from "./geometry.js";
import { MOST_STRUCTURES, type Scene, type Volumes } from "./scene.js";

/** Voxels that are shown as something else. `values` of voxels look like `as`, also where palpate draws the volume, which knows them all. */
export interface Concealed { lo: Vec3; size: Vec3; before: Uint8Array; now: Uint8Array; values: number[]; as: number }

/** The box around all voxels of some structures, by their places in the scene's list; null: they have none. */
function boxOf(volumes: Volumes, isWanted: boolean[]): { lo: Vec3; size: Vec3 } | null {
  const { dims: [nx, ny, nz], structure } = volumes;
  const lo: Vec3 = [nx, ny, nz], hi: Vec3 = [-1, -1, -1];
  for (let k = 0, n = 0; k < nz; k++) for (let j = 0; j < ny; j++) for (let i = 0; i < nx; i++, n++) {
    if (!isWanted[structure[n]!]) continue;
    [i, j, k].forEach((at, axis) => {
      lo[axis] = Math.min(lo[axis]!, at);
      hi[axis] = Math.max(hi[axis]!, at);
    });
  }
  return hi[0] < 0 ? null : { lo, size: [0, 1, 2].map((axis) => hi[axis]! - lo[axis]! + 1) as Vec3 };
}

/** What structures would be shown as: as the one that touches them at most faces of voxels. */
export function conceal(scene: Scene, volumes: Volumes, labels: number[]): Concealed | null {
  const isWanted = Array.from({ length: MOST_STRUCTURES + 1 }, (_, value) => value > 0 && labels.includes(scene.structures[value - 1]?.label ?? -1));
  const box = boxOf(volumes, isWanted);
  if (!box) return null;
  const { lo, size } = box;
  const { dims: [nx, ny, nz], structure } = volumes;
  const before = new Uint8Array(size[0] * size[1] * size[2]);
  const faces = new Uint32Array(MOST_STRUCTURES + 1);
  for (let k = 0, n = 0; k < size[2]; k++) for (let j = 0; j < size[1]; j++) for (let i = 0; i < size[0]; i++, n++) {
    const [x, y, z] = [lo[0] + i, lo[1] + j, lo[2] + k];
    const at = x + nx * (y + ny * z);
    before[n] = structure[at]!;
    if (!isWanted[before[n]!]) continue;
    const around = [x > 0 && at - 1, x + 1 < nx && at + 1, y > 0 && at - nx, y + 1 < ny && at + nx, z > 0 && at - nx * ny, z + 1 < nz && at + nx * ny];
    for (const other of around) if (other !== false && !isWanted[structure[other]!]) faces[structure[other]!]! += 1;
  }
  const around = faces.indexOf(Math.max(...faces));
  const values = isWanted.flatMap((is, value) => (is ? [value] : []));
  return { lo, size, before, now: before.map((value) => (isWanted[value] ? around : value)), values, as: around };
}

/** What of them is to be shown again: not what has changed meanwhile. */
export function revealed(volumes: Volumes, { lo, size, before, now }: Concealed): Uint8Array {
  const [nx, ny] = volumes.dims;
  return before.map((value, n) => {
    const [i, j, k] = [n % size[0], Math.floor(n / size[0]) % size[1], Math.floor(n / (size[0] * size[1]))];
    const is = volumes.structure[lo[0] + i + nx * (lo[1] + j + ny * (lo[2] + k))]!;
    return is === now[n] ? value : is;
  });
}
