// Concealment of voxels in a quiz: those of the structures to be found are replaced by their surroundings.

import type { Scene } from "../protocol/messages.js";
import type { Vec3 } from "../base/geometry.js";
import { MAX_STRUCTURES, type Volumes } from "../protocol/scene.js";

/**
 * Box of voxels before and after the replacement. In pictures that palpate renders from the original voxels, structures
 * whose value is in `values` have the appearance of `as`, the most frequent replacement.
 */
export interface Redacted {
  lo: Vec3;
  size: Vec3;
  before: Uint8Array;
  now: Uint8Array;
  values: number[];
  as: number;
}

/** Fraction of votes from which a structure replaces a whole component, as in src/viewer/server/redacted_labels.cc. */
const UNIFORM_SHARE = 0.75;

/** Bounding box of the voxels with concealed values; null: none. */
function boxOf(volumes: Volumes, isConcealed: boolean[]): { lo: Vec3; size: Vec3 } | null {
  const {
    dims: [nx, ny, nz],
    structure,
  } = volumes;
  const lo: Vec3 = [nx, ny, nz],
    hi: Vec3 = [-1, -1, -1];
  for (let k = 0, n = 0; k < nz; k++)
    for (let j = 0; j < ny; j++)
      for (let i = 0; i < nx; i++, n++) {
        if (!isConcealed[structure[n]!]) continue;
        [i, j, k].forEach((at, axis) => {
          lo[axis] = Math.min(lo[axis]!, at);
          hi[axis] = Math.max(hi[axis]!, at);
        });
      }
  return hi[0] < 0 ? null : { lo, size: [0, 1, 2].map((axis) => hi[axis]! - lo[axis]! + 1) as Vec3 };
}

/** Weighted votes for voxel values. */
class Votes {
  private readonly weights = new Map<number, number>();
  add(value: number, weight: number): void {
    this.weights.set(value, (this.weights.get(value) ?? 0) + weight);
  }
  get empty(): boolean {
    return this.weights.size === 0;
  }
  /** Value with the largest weight, the smallest on a tie; 0 without votes. */
  winner(): number {
    let [best, most] = [0, 0];
    for (const [value, weight] of this.weights)
      if (weight > most || (weight === most && value < best)) [best, most] = [value, weight];
    return best;
  }
  shareOf(value: number): number {
    const all = [...this.weights.values()].reduce((sum, weight) => sum + weight, 0);
    return all > 0 ? (this.weights.get(value) ?? 0) / all : 0;
  }
}

/** Directions to the 26 neighbours, one of each opposite pair. */
const DIRECTIONS: Vec3[] = [];
for (const k of [-1, 0, 1])
  for (const j of [-1, 0, 1])
    for (const i of [-1, 0, 1]) if (k > 0 || (k === 0 && (j > 0 || (j === 0 && i > 0)))) DIRECTIONS.push([i, j, k]);

/**
 * Replaces concealed voxels of a box, none of them in its outermost layer, by the rule of
 * src/viewer/server/redacted_labels.h: a straight line of concealed voxels between two voxels of the same structure is
 * evidence that this structure continues through it; air (0) is not counted.
 */
function fill(box: Uint8Array, size: Vec3, isConcealed: boolean[]): void {
  const strides: Vec3 = [1, size[0], size[0] * size[1]];
  const stride = (d: Vec3) => d[0] * strides[0] + d[1] * strides[1] + d[2] * strides[2];
  const faces = strides.flatMap((by) => [by, -by]);
  const hidden = new Map<number, Votes>();
  for (let at = 0; at < box.length; at++) if (isConcealed[box[at]!]) hidden.set(at, new Votes());

  // visits each line once, from its first voxel
  for (const by of DIRECTIONS.map(stride))
    for (const first of hidden.keys()) {
      const before = box[first - by]!;
      if (hidden.has(first - by) || before === 0) continue;
      let after = first,
        length = 0;
      for (; hidden.has(after); after += by) length++;
      if (box[after] === before) for (let at = first; at !== after; at += by) hidden.get(at)!.add(before, 1 / length);
    }

  const now = new Map<number, number>();
  const shown = (at: number) => now.get(at) ?? (hidden.has(at) ? 0 : box[at]!);
  const seen = new Set<number>();
  for (const start of hidden.keys()) {
    if (seen.has(start)) continue;
    const component = [start];
    seen.add(start);
    for (const at of component)
      for (const by of DIRECTIONS.map(stride))
        for (const next of [at + by, at - by]) {
          if (!hidden.has(next) || seen.has(next)) continue;
          seen.add(next);
          component.push(next);
        }
    const all = new Votes(),
      touched = new Votes();
    for (const at of component) {
      if (!hidden.get(at)!.empty) all.add(hidden.get(at)!.winner(), 1);
      for (const by of faces) if (!hidden.has(at + by) && box[at + by] !== 0) touched.add(box[at + by]!, 1);
    }
    const most = all.empty ? touched.winner() : all.winner();
    if (all.empty || all.shareOf(most) >= UNIFORM_SHARE) {
      for (const at of component) now.set(at, most);
      continue;
    }
    let open: number[] = [];
    for (const at of component)
      if (hidden.get(at)!.empty) open.push(at);
      else now.set(at, hidden.get(at)!.winner());
    // voxels without votes take the most frequent value of their neighbours, layer by layer
    while (open.length > 0) {
      const layer: [number, number][] = [],
        left: number[] = [];
      for (const at of open) {
        const around = new Votes();
        for (const by of faces) if (shown(at + by) !== 0) around.add(shown(at + by), 1);
        if (around.empty) left.push(at);
        else layer.push([at, around.winner()]);
      }
      if (layer.length === 0) break;
      for (const [at, value] of layer) now.set(at, value);
      open = left;
    }
  }
  for (const at of hidden.keys()) box[at] = now.get(at) ?? 0;
}

/** Replacement of all voxels of some labels by their surroundings; null: no such voxels. */
export function redact(scene: Scene, volumes: Volumes, labels: number[]): Redacted | null {
  const isConcealed = Array.from(
    { length: MAX_STRUCTURES + 1 },
    (_, value) => value > 0 && labels.includes(scene.structures[value - 1]?.label ?? -1),
  );
  const box = boxOf(volumes, isConcealed);
  if (!box) return null;
  const { lo, size } = box;
  const {
    dims: [nx, ny, nz],
    structure,
  } = volumes;
  // box with a margin of one voxel, which is air outside of the volume
  const wide = size.map((n) => n + 2) as Vec3;
  const around = new Uint8Array(wide[0] * wide[1] * wide[2]);
  for (let k = 0, n = 0; k < wide[2]; k++)
    for (let j = 0; j < wide[1]; j++)
      for (let i = 0; i < wide[0]; i++, n++) {
        const [x, y, z] = [lo[0] + i - 1, lo[1] + j - 1, lo[2] + k - 1];
        if (x >= 0 && y >= 0 && z >= 0 && x < nx && y < ny && z < nz) around[n] = structure[x + nx * (y + ny * z)]!;
      }
  const inner = (from: Uint8Array) =>
    Uint8Array.from({ length: size[0] * size[1] * size[2] }, (_, n) => {
      const [i, j, k] = [n % size[0], Math.floor(n / size[0]) % size[1], Math.floor(n / (size[0] * size[1]))];
      return from[i + 1 + wide[0] * (j + 1 + wide[1] * (k + 1))]!;
    });
  const before = inner(around);
  fill(around, wide, isConcealed);
  const now = inner(around);
  const became = new Votes();
  before.forEach((value, n) => {
    if (isConcealed[value]) became.add(now[n]!, 1);
  });
  const values = isConcealed.flatMap((is, value) => (is ? [value] : []));
  return { lo, size, before, now, values, as: became.winner() };
}

/** Structures of the box without the concealment; voxels that were changed since, by a burr, keep their value. */
export function revealed(volumes: Volumes, { lo, size, before, now }: Redacted): Uint8Array {
  const [nx, ny] = volumes.dims;
  return before.map((value, n) => {
    const [i, j, k] = [n % size[0], Math.floor(n / size[0]) % size[1], Math.floor(n / (size[0] * size[1]))];
    const is = volumes.structure[lo[0] + i + nx * (lo[1] + j + ny * (lo[2] + k))]!;
    return is === now[n] ? value : is;
  });
}
