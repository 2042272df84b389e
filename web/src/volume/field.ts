// Grid of texels for ray casting: each has the two most frequent structures and their shares, independent of
// appearances.
// Shares are smoothed over one texel in each direction: a surface, the isosurface of coverage 1/2, is then smooth and
// has a gradient for shading. A texel is a voxel, or a block of `factor` voxels.

import type { Vec3 } from "../base/geometry.js";
import { texelsFor, type Piece } from "./texels.js";

/** Side, in texels, of the blocks by which rays skip empty space. */
export const BLOCK = 8;
/** Bytes per texel: two structures (index + 1, 0 for none), and their shares (255 for the whole texel). */
export const TEXEL_BYTES = 4;

/** Accumulated shares of structures in the neighbourhood of a texel. */
class Fractions {
  private readonly sums = new Float64Array(256);
  private readonly met: number[] = [];

  add(structure: number, weight: number): void {
    if (this.sums[structure] === 0) this.met.push(structure);
    this.sums[structure]! += weight;
  }
  /**
   * Writes the two largest shares of structures. They absorb further ones, so that surfaces have no dents where three
   * structures meet.
   */
  write(texels: Uint8Array, at: number): void {
    let first = 0,
      second = 0,
      covered = 0,
      all = 0;
    for (const structure of this.met) {
      const sum = this.sums[structure]!;
      all += sum;
      if (structure === 0) continue;
      covered += sum;
      if (first === 0 || sum > this.sums[first]!) {
        second = first;
        first = structure;
      } else if (second === 0 || sum > this.sums[second]!) second = structure;
    }
    const two = (first > 0 ? this.sums[first]! : 0) + (second > 0 ? this.sums[second]! : 0);
    const total = Math.round((255 * covered) / all);
    const own = two > 0 ? Math.round((total * this.sums[first]!) / two) : 0;
    texels[at] = first;
    texels[at + 1] = second;
    texels[at + 2] = own;
    texels[at + 3] = total - own;
    for (const structure of this.met) this.sums[structure] = 0;
    this.met.length = 0;
  }
}

/** Shares of structures in each mixed texel, computed once for use by all its neighbours. */
class Mixtures {
  private readonly begins = [0];
  private readonly structures: number[] = [];
  private readonly parts: number[] = []; // shares of structures, 0 to 1, in texel after texel
  private readonly voxels = new Uint32Array(256); // histogram of the current texel
  private readonly met: number[] = [];

  get count(): number {
    return this.begins.length - 1;
  }
  add(structure: number): void {
    if (this.voxels[structure]!++ === 0) this.met.push(structure);
  }
  end(voxels: number): void {
    for (const structure of this.met) {
      this.structures.push(structure);
      this.parts.push(this.voxels[structure]! / voxels);
      this.voxels[structure] = 0;
    }
    this.met.length = 0;
    this.begins.push(this.structures.length);
  }
  into(fractions: Fractions, n: number, weight: number): void {
    for (let m = this.begins[n]!; m < this.begins[n + 1]!; m++)
      fractions.add(this.structures[m]!, weight * this.parts[m]!);
  }
}

export class Field {
  readonly dims: Vec3; // number of texels along each axis
  /** Number of texels including an empty border of one texel, which saves rays the bounds checks. */
  readonly bordered: Vec3;
  readonly texels: Uint8Array;
  /** Mean scan value of each texel, without the border; null: no scan. */
  readonly haze: Int16Array | null;
  readonly blocks: Vec3;
  private readonly present: Uint32Array; // bit set of the structures in each block, 8 words per block
  private readonly fractions = new Fractions();

  constructor(
    readonly voxels: Vec3,
    readonly factor: Vec3,
    hasScan: boolean,
  ) {
    this.dims = texelsFor(voxels, factor);
    this.bordered = this.dims.map((n) => n + 2) as Vec3;
    this.texels = new Uint8Array(this.bordered[0] * this.bordered[1] * this.bordered[2] * TEXEL_BYTES);
    this.haze = hasScan ? new Int16Array(this.dims[0] * this.dims[1] * this.dims[2]) : null;
    this.blocks = this.dims.map((n) => Math.ceil(n / BLOCK)) as Vec3;
    this.present = new Uint32Array(this.blocks[0] * this.blocks[1] * this.blocks[2] * 8);
  }

  /** Whether a texel is one voxel. */
  private get isWhole(): boolean {
    return this.factor.every((n) => n === 1);
  }
  /** Offset of a texel's bytes in `texels`. */
  at(x: number, y: number, z: number): number {
    return TEXEL_BYTES * (x + 1 + this.bordered[0] * (y + 1 + this.bordered[1] * (z + 1)));
  }

  put(piece: Piece): void {
    this.smooth(piece);
    if (piece.scan) this.mean(piece, piece.scan);
    this.updatePresent(piece.lo, piece.size);
  }

  /** Voxels of a texel within a piece: index of the first one, and number along each axis. */
  private blockOf(
    { from, span }: Piece,
    x: number,
    y: number,
    z: number,
  ): { first: number; ni: number; nj: number; nk: number } {
    const { factor, voxels } = this;
    const [i, j, k] = [x * factor[0], y * factor[1], z * factor[2]];
    return {
      first: i - from[0] + span[0] * (j - from[1] + span[1] * (k - from[2])),
      ni: Math.min(factor[0], voxels[0] - i),
      nj: Math.min(factor[1], voxels[1] - j),
      nk: Math.min(factor[2], voxels[2] - k),
    };
  }

  /** Contents of a box of texels and its neighbours: the structure that fills each texel, or -1 - n for mixture n. */
  private fillings(piece: Piece): { low: Vec3; count: Vec3; filling: Int32Array; mixtures: Mixtures } {
    const low = piece.lo.map((n) => Math.max(0, n - 1)) as Vec3;
    const count = piece.lo.map((n, axis) => Math.min(this.dims[axis]!, n + piece.size[axis]! + 1) - low[axis]!) as Vec3;
    const filling = new Int32Array(count[0] * count[1] * count[2]);
    const mixtures = new Mixtures();
    // without downsampling, texels are voxels
    if (this.isWhole) filling.set(piece.structure);
    else {
      const {
        structure,
        span: [si, sj],
      } = piece;
      for (let z = 0, n = 0; z < count[2]; z++) {
        for (let y = 0; y < count[1]; y++) {
          for (let x = 0; x < count[0]; x++, n++) {
            const { first, ni, nj, nk } = this.blockOf(piece, low[0] + x, low[1] + y, low[2] + z);
            const one = structure[first]!;
            let isFilled = true;
            for (let k = 0; k < nk && isFilled; k++) {
              for (let j = 0; j < nj && isFilled; j++) {
                const row = first + si * (j + sj * k);
                for (let at = row; at < row + ni; at++) if (structure[at] !== one) isFilled = false;
              }
            }
            filling[n] = isFilled ? one : -1 - mixtures.count;
            if (isFilled) continue;
            for (let k = 0; k < nk; k++)
              for (let j = 0; j < nj; j++) {
                const row = first + si * (j + sj * k);
                for (let at = row; at < row + ni; at++) mixtures.add(structure[at]!);
              }
            mixtures.end(ni * nj * nk);
          }
        }
      }
    }
    return { low, count, filling, mixtures };
  }

  /** Smooths shares by the kernel [1 2 1] / 4 along each axis; border texels of the volume are repeated outside. */
  private smooth(piece: Piece): void {
    const { lo, size } = piece;
    const { low, count, filling, mixtures } = this.fillings(piece);
    const rows = new Int32Array(9);
    const beside = (n: number, axis: number) => Math.min(count[axis]! - 1, Math.max(0, n));
    for (let z = 0; z < size[2]; z++) {
      for (let y = 0; y < size[1]; y++) {
        for (let r = 0; r < 9; r++) {
          const [yy, zz] = [
            beside(lo[1] - low[1] + y + (r % 3) - 1, 1),
            beside(lo[2] - low[2] + z + Math.floor(r / 3) - 1, 2),
          ];
          rows[r] = count[0] * (yy + count[1] * zz);
        }
        // structure that fills all nine texels at position x of the rows, or -1
        const across = (x: number): number => {
          const here = filling[rows[0]! + x]!;
          for (let r = 1; r < 9; r++) if (filling[rows[r]! + x] !== here) return -1;
          return here;
        };
        let out = this.at(lo[0], lo[1] + y, lo[2] + z);
        const first = lo[0] - low[0];
        let before = across(beside(first - 1, 0));
        let here = across(first);
        for (let x = first; x < first + size[0]; x++, out += TEXEL_BYTES) {
          const after = across(beside(x + 1, 0));
          if (here >= 0 && before === here && after === here) {
            this.texels[out] = here;
            this.texels[out + 1] = 0;
            this.texels[out + 2] = here > 0 ? 255 : 0;
            this.texels[out + 3] = 0;
          } else {
            this.gather(count[0], filling, mixtures, rows, x, out);
          }
          before = here;
          here = after;
        }
      }
    }
  }

  /** Computes one texel from its neighbourhood of 27 texels. */
  private gather(
    width: number,
    filling: Int32Array,
    mixtures: Mixtures,
    rows: Int32Array,
    x: number,
    out: number,
  ): void {
    for (let r = 0; r < 9; r++) {
      const weight = (r % 3 === 1 ? 2 : 1) * (Math.floor(r / 3) === 1 ? 2 : 1);
      for (let d = -1; d <= 1; d++) {
        const one = filling[rows[r]! + Math.min(width - 1, Math.max(0, x + d))]!;
        const share = d === 0 ? 2 * weight : weight;
        if (one >= 0) this.fractions.add(one, share);
        else mixtures.into(this.fractions, -1 - one, share);
      }
    }
    this.fractions.write(this.texels, out);
  }

  private mean(piece: Piece, scan: Int16Array): void {
    const { lo, size, from, span } = piece;
    for (let z = lo[2]; z < lo[2] + size[2]; z++) {
      for (let y = lo[1]; y < lo[1] + size[1]; y++) {
        let out = lo[0] + this.dims[0] * (y + this.dims[1] * z);
        if (this.isWhole) {
          const row = lo[0] - from[0] + span[0] * (y - from[1] + span[1] * (z - from[2]));
          this.haze!.set(scan.subarray(row, row + size[0]), out);
          continue;
        }
        for (let x = lo[0]; x < lo[0] + size[0]; x++, out++) {
          const { first, ni, nj, nk } = this.blockOf(piece, x, y, z);
          let sum = 0;
          for (let k = 0; k < nk; k++)
            for (let j = 0; j < nj; j++) {
              const row = first + span[0] * (j + span[1] * k);
              for (let at = row; at < row + ni; at++) sum += scan[at]!;
            }
          this.haze![out] = Math.round(sum / (ni * nj * nk));
        }
      }
    }
  }

  /** Updates `present` for the blocks that a box of texels intersects. */
  private updatePresent(lo: Vec3, size: Vec3): void {
    const { blocks, dims, texels, present } = this;
    const [first, last] = [lo.map((n) => n >> 3), lo.map((n, axis) => (n + size[axis]! - 1) >> 3)];
    for (let bz = first[2]!; bz <= last[2]!; bz++) {
      for (let by = first[1]!; by <= last[1]!; by++) {
        for (let bx = first[0]!; bx <= last[0]!; bx++) {
          const bits = present.subarray(8 * (bx + blocks[0] * (by + blocks[1] * bz))).subarray(0, 8);
          bits.fill(0);
          for (let z = bz * BLOCK; z < Math.min(dims[2], (bz + 1) * BLOCK); z++) {
            for (let y = by * BLOCK; y < Math.min(dims[1], (by + 1) * BLOCK); y++) {
              let at = this.at(bx * BLOCK, y, z);
              const end = at + TEXEL_BYTES * Math.min(BLOCK, dims[0] - bx * BLOCK);
              // most texels equal their predecessor
              for (let one = -1, other = -1; at < end; at += TEXEL_BYTES) {
                if (texels[at] === one && texels[at + 1] === other) continue;
                one = texels[at]!;
                other = texels[at + 1]!;
                bits[one >> 5]! |= 1 << (one & 31);
                bits[other >> 5]! |= 1 << (other & 31);
              }
            }
          }
        }
      }
    }
  }

  /**
   * Coverage of each texel of a box by opaque and by translucent structures: two bytes, x fastest.
   * @param appearances  256 RGBA values: 0 for no structure, then the structures in order
   */
  covers(lo: Vec3, size: Vec3, appearances: ArrayLike<number>): Uint8Array<ArrayBuffer> {
    const { texels } = this;
    const opacities = Array.from({ length: 256 }, (_, index) => appearances[4 * index + 3]!);
    const solid = Uint8Array.from(opacities, (opacity) => Number(opacity === 255));
    const thin = Uint8Array.from(opacities, (opacity) => Number(opacity > 0 && opacity < 255));
    const covers = new Uint8Array(2 * size[0] * size[1] * size[2]);
    for (let z = 0, out = 0; z < size[2]; z++) {
      for (let y = 0; y < size[1]; y++) {
        let at = this.at(lo[0], lo[1] + y, lo[2] + z);
        for (let x = 0; x < size[0]; x++, at += TEXEL_BYTES, out += 2) {
          const [first, second, own, other] = [texels[at]!, texels[at + 1]!, texels[at + 2]!, texels[at + 3]!];
          covers[out] = own * solid[first]! + other * solid[second]!;
          covers[out + 1] = own * thin[first]! + other * thin[second]!;
        }
      }
    }
    return covers;
  }

  /**
   * Chebyshev distance of each block to the nearest block with a visible structure, in blocks, at most 255.
   * @param shown  whether a structure is visible, indexed by the structure's index + 1
   */
  skips(shown: ArrayLike<unknown>): Uint8Array {
    const mask = new Uint32Array(8);
    for (let index = 1; index < 256; index++) if (shown[index]) mask[index >> 5]! |= 1 << (index & 31);
    const [nx, ny, nz] = this.blocks;
    const skips = new Uint8Array(nx * ny * nz);
    for (let n = 0; n < skips.length; n++) {
      let any = 0;
      for (let w = 0; w < 8; w++) any |= this.present[8 * n + w]! & mask[w]!;
      skips[n] = any !== 0 ? 0 : 255;
    }
    // chessboard distance transform: a forward and a backward pass over the preceding neighbours
    const pass = (step: 1 | -1) => {
      const order = (n: number, count: number) => (step > 0 ? n : count - 1 - n);
      for (let c = 0; c < nz; c++) {
        for (let b = 0; b < ny; b++) {
          for (let a = 0; a < nx; a++) {
            const [x, y, z] = [order(a, nx), order(b, ny), order(c, nz)];
            const n = x + nx * (y + ny * z);
            let least = skips[n]!;
            if (least === 0) continue;
            for (let q = 0; q < 13; q++) {
              const [dx, dy, dz] = [(q % 3) - 1, (Math.floor(q / 3) % 3) - 1, Math.floor(q / 9) - 1];
              const [xx, yy, zz] = [x + step * dx, y + step * dy, z + step * dz];
              if (xx < 0 || yy < 0 || zz < 0 || xx >= nx || yy >= ny || zz >= nz) continue;
              least = Math.min(least, skips[xx + nx * (yy + ny * zz)]! + 1);
            }
            skips[n] = least;
          }
        }
      }
    };
    pass(1);
    pass(-1);
    return skips;
  }
}
