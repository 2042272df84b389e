// Download of the scene (/api/scene) and of its volumes.

import type { Scene } from "./messages.js";
import { errorOf, versionError } from "../words/errors.js";
import { transport } from "./transport.js";
import { PROTOCOL } from "./wire.js";
import { apply, compose, invert, type Affine, type Vec3 } from "../base/geometry.js";
import { inPieces, PIECE_VOXELS } from "../base/pieces.js";
import { words, type Words } from "../words/words.js";

/**
 * Whether two scenes have the same voxels at the same positions and the same structures in the same order, so that
 * downloads and settings of one are valid for the other. The hash covers only the values of voxels.
 */
export function showsTheSame(a: Scene, b: Scene | null): boolean {
  const shown = ({ volume, world_from_patient, structures }: Scene) =>
    JSON.stringify([volume, world_from_patient, structures.map(({ label }) => label)]);
  return b !== null && shown(a) === shown(b);
}

export class NeedsToken extends Error {}

/** @throws NeedsToken for 401; Lasting for permanent errors; another Error for errors that may be temporary */
async function get(path: string, token: string | null): Promise<Response> {
  const response = await transport().get(path, token);
  if (response.status === 401) throw new NeedsToken();
  if (!response.ok) throw errorOf(path, response.status);
  return response;
}

export async function fetchScene(token: string | null): Promise<Scene> {
  const scene = (await (await get("/api/scene", token)).json()) as Scene;
  if (scene.protocol !== PROTOCOL) throw versionError(PROTOCOL, { version: scene.protocol, palpate: scene.palpate });
  return scene;
}

/** Capacity of the renderer: total number of texels, and texels along one side. */
export interface Memory {
  maxTexels: number;
  maxSide: number;
}

/** Smallest downsampling factor (1, 2 or 4) with which the volume fits the renderer. */
export function shrinkFor(dims: Vec3, memory: Memory): 1 | 2 | 4 {
  for (const shrink of [1, 2] as const) {
    const shrunk = dims.map((n) => Math.ceil(n / shrink));
    if (Math.max(...shrunk) <= memory.maxSide && shrunk.reduce((a, b) => a * b) <= memory.maxTexels) return shrink;
  }
  return 4;
}

/** `patient_from_voxel` of a downsampled grid, whose voxels are means of blocks of the given size. */
export function shrunkGrid(patientFromVoxel: Affine, [x, y, z]: Vec3): Affine {
  return compose(patientFromVoxel, [
    [x, 0, 0, (x - 1) / 2],
    [0, y, 0, (y - 1) / 2],
    [0, 0, z, (z - 1) / 2],
    [0, 0, 0, 1],
  ]);
}

/** Value of removed voxels in sections, unless a structure has it. */
export const REMOVED = 255;

/** Scan and structures on one grid. `structure`: for each voxel, index in the scene's list + 1, or 0. */
export class Volumes {
  readonly voxelFromPatient: Affine;
  readonly centre: Vec3; // patient, mm
  readonly edges: Vec3; // lengths of a voxel's edges, mm
  readonly size: number; // length of the diagonal, mm
  readonly voxelSize: number; // shortest edge, mm
  /** Indices of voxels that a burr has removed; `structure` is 0 there. */
  readonly removed = new Set<number>();
  private isFull: boolean | null = null; // there are as many structures as values; null: not known yet

  constructor(
    readonly hash: string,
    readonly shrink: number,
    readonly dims: Vec3,
    readonly patientFromVoxel: Affine,
    readonly scan: Int16Array | null,
    readonly structure: Uint8Array,
    private readonly scale: number,
    private readonly offset: number,
  ) {
    this.voxelFromPatient = invert(patientFromVoxel);
    this.centre = apply(patientFromVoxel, dims.map((n) => (n - 1) / 2) as Vec3);
    this.edges = [0, 1, 2].map((c) => Math.hypot(...[0, 1, 2].map((r) => patientFromVoxel[r]![c]!))) as Vec3;
    this.size = Math.hypot(...this.edges.map((edge, i) => edge * dims[i]!));
    this.voxelSize = Math.min(...this.edges);
  }

  /** Corners of the grid; patient frame. */
  get corners(): Vec3[] {
    return this.cornersOf([-0.5, -0.5, -0.5], this.dims.map((n) => n - 0.5) as Vec3);
  }
  /** Corners of the box of all voxels with a structure, of the grid if there is none; patient frame. */
  get objectCorners(): Vec3[] {
    const [ni, nj, nk] = this.dims;
    const [lo, hi]: [Vec3, Vec3] = [
      [ni, nj, nk],
      [-1, -1, -1],
    ];
    for (let k = 0; k < nk; k++) {
      for (let j = 0; j < nj; j++) {
        const row = ni * (j + nj * k);
        let first = 0;
        while (first < ni && this.structure[row + first] === 0) first++;
        if (first === ni) continue;
        let last = ni - 1;
        while (last > hi[0] && this.structure[row + last] === 0) last--;
        [lo[0], hi[0]] = [Math.min(lo[0], first), Math.max(hi[0], last)];
        [lo[1], hi[1]] = [Math.min(lo[1], j), Math.max(hi[1], j)];
        [lo[2], hi[2]] = [Math.min(lo[2], k), Math.max(hi[2], k)];
      }
    }
    return hi[0] < 0 ? this.corners : this.cornersOf(lo.map((n) => n - 0.5) as Vec3, hi.map((n) => n + 0.5) as Vec3);
  }
  private cornersOf(lo: Vec3, hi: Vec3): Vec3[] {
    return Array.from({ length: 8 }, (_, n) =>
      apply(this.patientFromVoxel, [0, 1, 2].map((axis) => ((n >> axis) & 1 ? hi : lo)[axis]!) as Vec3),
    );
  }

  /** Replaces the structures in a box of voxels, i fastest: index in the scene's list + 1, or 0. */
  write(lo: Vec3, size: Vec3, bytes: Uint8Array): void {
    for (let k = 0, n = 0; k < size[2]; k++) {
      for (let j = 0; j < size[1]; j++, n += size[0]) {
        this.structure.set(
          bytes.subarray(n, n + size[0]),
          lo[0] + this.dims[0] * (lo[1] + j + this.dims[1] * (lo[2] + k)),
        );
      }
    }
  }

  /** Value of a voxel in sections: as in `structure`, but REMOVED if it was removed. */
  shownAt(index: number): number {
    const value = this.structure[index]!;
    if (value > 0 || !this.removed.has(index)) return value;
    this.isFull ??= this.structure.includes(REMOVED);
    return this.isFull ? 0 : REMOVED;
  }
  /** Values of a box of voxels in sections, i fastest. */
  shownIn(lo: Vec3, size: Vec3): Uint8Array {
    const shown = new Uint8Array(size[0] * size[1] * size[2]);
    for (let k = 0, n = 0; k < size[2]; k++)
      for (let j = 0; j < size[1]; j++)
        for (let i = 0; i < size[0]; i++, n++)
          shown[n] = this.shownAt(lo[0] + i + this.dims[0] * (lo[1] + j + this.dims[1] * (lo[2] + k)));
    return shown;
  }

  /** Linear index of the nearest voxel; null outside of the grid. */
  private indexAt(p: Vec3): number | null {
    const v = apply(this.voxelFromPatient, p).map(Math.round) as Vec3;
    if (v.some((n, axis) => n < 0 || n >= this.dims[axis]!)) return null;
    return v[0] + this.dims[0] * (v[1] + this.dims[1] * v[2]);
  }
  /** Index of the structure at a position, patient frame, in the scene's list; null: none. */
  structureAt(p: Vec3): number | null {
    const index = this.indexAt(p);
    const value = index === null ? 0 : this.structure[index]!;
    return value > 0 ? value - 1 : null;
  }
  /** Value of the scan at a position, patient frame; null: outside, or no scan. */
  valueAt(p: Vec3): number | null {
    const index = this.indexAt(p);
    return index === null || !this.scan ? null : this.scan[index]! * this.scale + this.offset;
  }
}

/** Maximum number of structures that pictures distinguish: one byte per voxel. */
export const MAX_STRUCTURES = 255;

/**
 * Body of a response.
 * @param onMore  called with the length of each received chunk
 * @throws Error if its length is not `size`
 */
async function bytesOf(
  response: Response,
  what: "scan" | "labels",
  size: number,
  onMore: (bytes: number) => void,
): Promise<ArrayBuffer> {
  const bytes = new Uint8Array(size);
  let had = 0;
  const reader = response.body!.getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    if (had + value.length <= size) bytes.set(value, had);
    had += value.length;
    onMore(value.length);
  }
  if (had !== size) throw new Error(words.cameWith(what, String(had)));
  return bytes.buffer;
}

/** @param onProgress  called with the download progress, 0 to 1 */
export async function fetchVolumes(
  scene: Scene,
  shrink: 1 | 2 | 4,
  token: string | null,
  onProgress: (fraction: number) => void,
): Promise<Volumes> {
  const { hash, scan, labels, dims: whole, patient_from_voxel } = scene.volume;
  const dims = whole.map((n) => Math.ceil(n / shrink)) as Vec3;
  const voxels = dims[0] * dims[1] * dims[2];
  const labelSize = labels.type === "uint8" ? 1 : 2;
  const all = voxels * (labelSize + (scan ? 2 : 0));
  let come = 0;
  const fetchBytes = async (kind: "scan" | "labels", bytesPerVoxel: number) => {
    const query = shrink > 1 ? `?shrink=${shrink}` : "";
    return bytesOf(await get(`/api/volume/${kind}/${hash}${query}`, token), kind, voxels * bytesPerVoxel, (bytes) =>
      onProgress((come += bytes) / all),
    );
  };
  const [scanBytes, labelBytes] = await Promise.all([
    scan ? fetchBytes("scan", 2) : null,
    fetchBytes("labels", labelSize),
  ]);

  // index in the scene's list + 1 by label, or 0
  const valueOfLabel = new Uint8Array(65536);
  scene.structures.slice(0, MAX_STRUCTURES).forEach((structure, value) => (valueOfLabel[structure.label] = value + 1));
  const raw = labels.type === "uint8" ? new Uint8Array(labelBytes) : new Uint16Array(labelBytes);
  const structure = new Uint8Array(voxels);
  await inPieces(voxels, PIECE_VOXELS, (from, to) => {
    for (let i = from; i < to; i++) structure[i] = valueOfLabel[raw[i]!]!;
  });

  return new Volumes(
    hash,
    shrink,
    dims,
    shrunkGrid(patient_from_voxel, [shrink, shrink, shrink]),
    scanBytes && new Int16Array(scanBytes),
    structure,
    scan?.scale ?? 1,
    scan?.offset ?? 0,
  );
}

/** Intensity windows for CT by purpose: level and width, HU. */
export const CT_PRESETS = {
  softTissue: { level: 40, width: 400 },
  bone: { level: 500, width: 2000 },
  lung: { level: -600, width: 1500 },
  brain: { level: 40, width: 80 },
  abdomen: { level: 60, width: 350 },
  angio: { level: 300, width: 600 },
} satisfies Partial<Record<keyof Words["presets"], { level: number; width: number }>>;
