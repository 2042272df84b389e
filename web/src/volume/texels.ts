// Downsampling for the renderer (field.ts): number of voxels per texel, texels affected by a box of voxels, and pieces
// in which voxels are sent.

import type { Vec3 } from "../base/geometry.js";
import type { Memory } from "../protocol/scene.js";

/** Box of texels, with the voxels that determine them. */
export interface Piece {
  lo: Vec3; // first texel
  size: Vec3;
  from: Vec3; // first voxel
  span: Vec3;
  structure: Uint8Array; // voxels, i fastest: index in the scene's list + 1, or 0
  scan: Int16Array | null;
}

/** Number of texels along each axis. */
export const texelsFor = (voxels: Vec3, factor: Vec3): Vec3 =>
  voxels.map((n, axis) => Math.ceil(n / factor[axis]!)) as Vec3;

/**
 * Number of voxels per texel along each axis with which the grid fits the memory. The finest axis is coarsened first.
 * @param edges  lengths of a voxel's edges, mm
 */
export function coarsening(dims: Vec3, edges: Vec3, { maxTexels, maxSide }: Memory): Vec3 {
  const factor: Vec3 = [1, 1, 1];
  for (;;) {
    const texels = texelsFor(dims, factor);
    // sides include the border (Field.bordered)
    const long = texels.findIndex((n) => n + 2 > maxSide);
    if (long < 0 && texels[0] * texels[1] * texels[2] <= maxTexels) return factor;
    const size = factor.map((n, axis) => (texels[axis]! > 1 ? n * edges[axis]! : Infinity));
    factor[long < 0 ? size.indexOf(Math.min(...size)) : long]! += 1;
  }
}

/** Box of texels affected by a box of voxels, including the neighbours that smoothing reaches. */
export function texelsOf(lo: Vec3, size: Vec3, voxels: Vec3, factor: Vec3): { lo: Vec3; size: Vec3 } {
  const dims = texelsFor(voxels, factor);
  const first = lo.map((n, axis) => Math.max(0, Math.floor(n / factor[axis]!) - 1)) as Vec3;
  const end = lo.map((n, axis) => Math.min(dims[axis]!, Math.floor((n + size[axis]! - 1) / factor[axis]!) + 2));
  return { lo: first, size: end.map((n, axis) => n - first[axis]!) as Vec3 };
}

/** Piece with a copy of the volume's voxels for a box of texels. */
export function pieceOf(
  volume: { dims: Vec3; structure: Uint8Array; scan: Int16Array | null },
  factor: Vec3,
  lo: Vec3,
  size: Vec3,
): Piece {
  const from = lo.map((n, axis) => Math.max(0, (n - 1) * factor[axis]!)) as Vec3;
  const span = lo.map(
    (n, axis) => Math.min(volume.dims[axis]!, (n + size[axis]! + 1) * factor[axis]!) - from[axis]!,
  ) as Vec3;
  const copy = <T extends Uint8Array | Int16Array>(all: T, out: T): T => {
    for (let k = 0, n = 0; k < span[2]; k++) {
      for (let j = 0; j < span[1]; j++, n += span[0]) {
        const at = from[0] + volume.dims[0] * (from[1] + j + volume.dims[1] * (from[2] + k));
        out.set(all.subarray(at, at + span[0]) as T, n);
      }
    }
    return out;
  };
  const voxels = span[0] * span[1] * span[2];
  return {
    lo,
    size,
    from,
    span,
    structure: copy(volume.structure, new Uint8Array(voxels)),
    scan: volume.scan && copy(volume.scan, new Int16Array(voxels)),
  };
}
