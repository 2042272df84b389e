// What /api/scene and the state messages say, and the volumes that belong to them.

import type { Refusal } from "./connection.js";
import { apply, compose, invert, type Affine, type Quaternion, type Vec3 } from "./geometry.js";

export type Rgb = [number, number, number];
export interface Structure { label: number; name: string; colour: Rgb; tissue: number }
export interface Tissue {
  name: string;
  felt: boolean;
  colour: Rgb;
  opacity: number;
  stiffness_N_per_mm: number;
  static_friction: number;
  dynamic_friction: number;
  viscosity_N_s_per_mm: number;
  rests_on: number[];
}
export type TissueState = Pick<Tissue, "stiffness_N_per_mm" | "static_friction" | "dynamic_friction" | "viscosity_N_s_per_mm">;

export interface Scene {
  protocol: number;
  palpate: string;
  role: "view" | "control";
  side: "left" | "right" | "both" | "unknown";
  oriented: boolean;
  modality: "ct" | "mr" | "unknown";
  volume: {
    hash: string;
    dims: Vec3;
    patient_from_voxel: Affine;
    scan: { scale: number; offset: number; window: [number, number]; range: [number, number] } | null;
    labels: { type: "uint8" | "uint16" };
  };
  world_from_patient: Affine;
  structures: Structure[];
  tissues: Tissue[];
  tool: { name: string; radius_mm: number; points_mm: Vec3[] };
  methods: string[];
  device: {
    name: string;
    simulated: boolean;
    input: "script" | "pointer" | "device";
    peak_force_N: number | null;
    continuous_force_N: number | null;
    most_stiffness_N_per_mm: number | null;
  };
  limits: {
    max_force_N: number;
    least_max_force_N: number;
    most_max_force_N: number;
    stiffness_N_per_mm: [number, number];
    friction: [number, number];
  };
  rate_hz: number;
}

export interface State {
  method: string;
  method_awaited: string | null; // until its fields are made
  method_failed: Refusal | null; // why the one that was asked for last is not felt
  friction: boolean;
  viscosity: boolean;
  passivity: boolean;
  paused: boolean;
  emergency_stop: boolean;
  stop: number | null; // which stop holds; a rearm names it
  max_force_N: number;
  rotation_wxyz: Quaternion;
  model_version: number;
  tissues: TissueState[];
  armed: boolean;
  recording: boolean;
  viewers: number;
  pointer: boolean;
}

/** palpate::ForceMethod, in the order of the numbers in poses. */
export const METHODS = ["trilinear", "b-spline", "gaussian-sphere", "smooth-sphere", "stored-normals", "proxy"];

export class NeedsToken extends Error {}

/** @throws NeedsToken for 401; Error with what the server said otherwise */
async function get(path: string, token: string | null): Promise<Response> {
  const response = await fetch(path, token ? { headers: { Authorization: `Bearer ${token}` } } : {});
  if (response.status === 401) throw new NeedsToken();
  if (!response.ok) throw new Error(`${path} answered ${response.status}`);
  return response;
}

export async function fetchScene(token: string | null): Promise<Scene> {
  return (await (await get("/api/scene", token)).json()) as Scene;
}

export interface Memory { mostTexels: number; mostSide: number }

/** The least of 1, 2 and 4 by which the volume is small enough for this device. */
export function shrinkFor(dims: Vec3, memory: Memory): 1 | 2 | 4 {
  for (const shrink of [1, 2] as const) {
    const shrunk = dims.map((n) => Math.ceil(n / shrink));
    if (Math.max(...shrunk) <= memory.mostSide && shrunk.reduce((a, b) => a * b) <= memory.mostTexels) return shrink;
  }
  return 4;
}

/** `patient_from_voxel` of a grid whose voxels are means of `shrink`^3 voxels. */
export function shrunkGrid(patientFromVoxel: Affine, shrink: number): Affine {
  const centre = (shrink - 1) / 2;
  return compose(patientFromVoxel, [
    [shrink, 0, 0, centre],
    [0, shrink, 0, centre],
    [0, 0, shrink, centre],
    [0, 0, 0, 1],
  ]);
}

/** Scan and labels on one grid, as they were fetched. `structure` has, per voxel, 0 or the place in the list + 1. */
export class Volumes {
  readonly voxelFromPatient: Affine;
  readonly centre: Vec3; // patient, mm
  readonly size: number; // of the diagonal, mm
  readonly voxelSize: number; // the least, mm

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
    const edges = [0, 1, 2].map((c) => Math.hypot(...[0, 1, 2].map((r) => patientFromVoxel[r]![c]!)));
    this.size = Math.hypot(...edges.map((edge, i) => edge * dims[i]!));
    this.voxelSize = Math.min(...edges);
  }

  /** Of the nearest voxel, or null outside. */
  private indexAt(p: Vec3): number | null {
    const v = apply(this.voxelFromPatient, p).map(Math.round) as Vec3;
    if (v.some((n, axis) => n < 0 || n >= this.dims[axis]!)) return null;
    return v[0] + this.dims[0] * (v[1] + this.dims[1] * v[2]);
  }
  /** The structure's place in the scene's list, or null. */
  structureAt(p: Vec3): number | null {
    const index = this.indexAt(p);
    const place = index === null ? 0 : this.structure[index]!;
    return place > 0 ? place - 1 : null;
  }
  /** The scan's value, or null. */
  valueAt(p: Vec3): number | null {
    const index = this.indexAt(p);
    return index === null || !this.scan ? null : this.scan[index]! * this.scale + this.offset;
  }
}

/** Structures beyond these are not told apart in pictures. */
export const MOST_STRUCTURES = 255;

export async function fetchVolumes(scene: Scene, shrink: 1 | 2 | 4, token: string | null): Promise<Volumes> {
  const { hash, scan, labels, dims: whole, patient_from_voxel } = scene.volume;
  const dims = whole.map((n) => Math.ceil(n / shrink)) as Vec3;
  const voxels = dims[0] * dims[1] * dims[2];
  const fetchBytes = async (kind: "scan" | "labels", bytesPerVoxel: number) => {
    const query = shrink > 1 ? `?shrink=${shrink}` : "";
    const bytes = await (await get(`/api/volume/${kind}/${hash}${query}`, token)).arrayBuffer();
    if (bytes.byteLength !== voxels * bytesPerVoxel) throw new Error(`the ${kind} came with ${bytes.byteLength} bytes`);
    return bytes;
  };
  const [scanBytes, labelBytes] = await Promise.all([
    scan ? fetchBytes("scan", 2) : null,
    fetchBytes("labels", labels.type === "uint8" ? 1 : 2),
  ]);

  // labels to places in the list of structures, which fit a byte
  const places = new Uint8Array(65536);
  scene.structures.slice(0, MOST_STRUCTURES).forEach((structure, place) => (places[structure.label] = place + 1));
  const raw = labels.type === "uint8" ? new Uint8Array(labelBytes) : new Uint16Array(labelBytes);
  const structure = new Uint8Array(voxels);
  for (let i = 0; i < voxels; i++) structure[i] = places[raw[i]!]!;

  return new Volumes(hash, shrink, dims, shrink > 1 ? shrunkGrid(patient_from_voxel, shrink) : patient_from_voxel,
    scanBytes && new Int16Array(scanBytes), structure, scan?.scale ?? 1, scan?.offset ?? 0);
}

export const SIDE_TEXT = { left: "LEFT", right: "RIGHT", both: "BOTH SIDES", unknown: "SIDE UNKNOWN" } as const;
export const NOTICE = "Research and education — not for clinical use";

/** Windows of Hounsfield units by their clinical names, as level and width. */
export const CT_PRESETS: Record<string, { level: number; width: number }> = {
  "Soft tissue": { level: 40, width: 400 },
  Bone: { level: 500, width: 2000 },
  Lung: { level: -600, width: 1500 },
  Brain: { level: 40, width: 80 },
  Abdomen: { level: 60, width: 350 },
  Angio: { level: 300, width: 600 },
};
