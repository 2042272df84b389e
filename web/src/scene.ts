// What /api/scene and the state messages say, and the volumes that belong to them.

import type { Refusal, Right, Role } from "./connection.js";
import { troubleOf, versionTrouble } from "./trouble.js";
import { PROTOCOL } from "./wire.js";
import { apply, compose, invert, type Affine, type Quaternion, type Vec3 } from "./geometry.js";
import { inPieces, PIECE_VOXELS } from "./pieces.js";
import type { Task } from "./training.js";
import { words, type Words } from "./words.js";

export type Rgb = [number, number, number];
export type Concern = "placement" | "side" | "force";
export interface Structure { label: number; name: string; colour: Rgb; tissue: number; within: number[] }
export interface Tissue {
  name: string;
  felt: boolean;
  protection: "none" | "alarm" | "keep"; // from a burr
  colour: Rgb;
  opacity: number;
  stiffness_N_per_mm: number;
  static_friction: number;
  friction: number;
  viscosity_N_s_per_mm: number;
  rests_on: number[];
}
/** A long part of the tool: from one end of its axis to the other, in the tool's own frame, and its radii there. */
export interface Capsule { from_mm: Vec3; to_mm: Vec3; radius_mm: number; end_radius_mm: number }
/** What a device holds. */
export interface HeldTool { name: string; radius_mm: number; cuts: boolean; burr: "ball" | "cylinder" | "cone" | null; shaver: boolean; points_mm: Vec3[]; capsules: Capsule[] }
/** A region that pushes a tool out which comes nearer to it than `keep_away_mm`: a structure's label, all that lies behind a plane, or a ball. */
export interface NoGo { name: string; keep_away_mm: number; label: number | null; plane: { point_mm: Vec3; outward: Vec3 } | null; ball: { centre_mm: Vec3; radius_mm: number } | null }
export type TissueState = Pick<Tissue, "stiffness_N_per_mm" | "static_friction" | "friction" | "viscosity_N_s_per_mm">;

export interface Scene {
  protocol: number;
  palpate: string;
  role: Role;
  learner: string | null;
  may: Right[];
  side: "left" | "right" | "both" | "unknown";
  oriented: boolean;
  caveats: { concerns: Concern; text: string }[]; // limitations of the model that loading found, a sentence each
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
  tools: HeldTool[]; // of each device
  methods: string[];
  laws: string[]; // of soft tissue; none where nothing is soft
  device: {
    name: string;
    simulated: boolean;
    input: "script" | "pointer" | "device" | "recording";
    peak_force_N: number | null;
    continuous_force_N: number | null;
    max_stiffness_N_per_mm: number | null;
  };
  limits: {
    max_force_N: number;
    min_max_force_N: number;
    max_max_force_N: number;
    stiffness_N_per_mm: [number, number];
    friction: [number, number];
  };
  rate_hz: number;
  recording: Recording | null; // that is looked at, where no session runs
  tasks?: Task[]; // that may be begun
  distances: { reach_mm: number } | null; // of structures so near to a tool it is told how far they are; null: of none
  no_go: NoGo[];
}

/**
 * Whether two scenes are the same voxels at the same places, with the same structures in the same order: what was loaded and chosen for one
 * holds for the other. The hash is of the voxels' values alone.
 */
export function showsTheSame(a: Scene, b: Scene | null): boolean {
  const shown = ({ volume, world_from_patient, structures }: Scene) => JSON.stringify([volume, world_from_patient, structures.map(({ label }) => label)]);
  return b !== null && shown(a) === shown(b);
}

export interface RecordedEvent {
  time_s: number;
  kind: "stop" | "rearm" | "settings" | "model" | "undo" | "redo";
  changed: string[];
  tissue: number | null;
  by: string;
  viewer: number | null;
}
/** What a time line shows; times are the recording's own. */
export interface Recording {
  ticks: number;
  begin_s: number;
  end_s: number;
  contacts: [begin_s: number, end_s: number, label: number, max_N: number, device: number][];
  contacts_left_out: number;
  events: RecordedEvent[];
  events_left_out: number;
  force_N: number[]; // greatest in each of equally many ticks
}

export interface State {
  method: string;
  law: string; // of soft tissue
  law_awaited: string | null; // until its surfaces are made
  law_failed: Refusal | null; // why the one that was asked for last is not felt
  method_awaited: string | null; // until its fields are made
  method_failed: Refusal | null; // why the one that was asked for last is not felt
  friction: boolean;
  viscosity: boolean;
  passivity: boolean;
  paused: boolean;
  motor: boolean; // of a tool that cuts: its switch
  motor_is_on: boolean; // by its switch or a pedal
  strokes: { undo: number; redo: number }; // of it, from motor on to motor off: so many can be taken back, and brought again
  removed: { label: number; mm3: number }[]; // by it, of each structure
  nearest: { label: number; mm: number }[]; // its ball came so near to what is protected
  emergency_stop: boolean;
  stop: number | null; // which stop holds; a rearm names it
  stopped_by: "you" | "viewer" | "key" | "palpate" | null; // who asked for it
  max_force_N: number;
  rotation_wxyz: Quaternion;
  model_version: number;
  tissues: TissueState[];
  armed: boolean;
  recording: boolean;
  playback: { playing: boolean; speed: number; failed: Refusal | null } | null; // of a recording that is looked at
  viewers: number;
  pointer: boolean;
  pointer_by: "you" | "viewer" | null; // who moves the tip
  lesson: Lesson;
}
/** What a teacher has chosen, as this viewer is told it. */
export interface Lesson {
  learner: string | null; // whose the runs are; told to the teacher and to that learner
  of_another: boolean; // to a learner: not his or hers
  task: string | null; // the only one that may be begun
  names: boolean; // learners are shown what a quiz hides
  veiled: boolean; // this one is not
}


export class NeedsToken extends Error {}

/** @throws NeedsToken for 401; Lasting for what trying again does not mend; another Error for what may be over later */
async function get(path: string, token: string | null): Promise<Response> {
  const response = await fetch(path, token ? { headers: { Authorization: `Bearer ${token}` } } : {});
  if (response.status === 401) throw new NeedsToken();
  if (!response.ok) throw troubleOf(path, response.status);
  return response;
}

export async function fetchScene(token: string | null): Promise<Scene> {
  const scene = (await (await get("/api/scene", token)).json()) as Scene;
  if (scene.protocol !== PROTOCOL) throw versionTrouble(PROTOCOL, { version: scene.protocol, palpate: scene.palpate });
  return scene;
}

/** What the device holds of a volume, and of a side of it. */
export interface Memory { mostTexels: number; mostSide: number }

/** The least of 1, 2 and 4 by which the volume is small enough for this device. */
export function shrinkFor(dims: Vec3, memory: Memory): 1 | 2 | 4 {
  for (const shrink of [1, 2] as const) {
    const shrunk = dims.map((n) => Math.ceil(n / shrink));
    if (Math.max(...shrunk) <= memory.mostSide && shrunk.reduce((a, b) => a * b) <= memory.mostTexels) return shrink;
  }
  return 4;
}

/** `patient_from_voxel` of a grid whose voxels are means of so many voxels each way. */
export function shrunkGrid(patientFromVoxel: Affine, [x, y, z]: Vec3): Affine {
  return compose(patientFromVoxel, [
    [x, 0, 0, (x - 1) / 2],
    [0, y, 0, (y - 1) / 2],
    [0, 0, z, (z - 1) / 2],
    [0, 0, 0, 1],
  ]);
}

/** Scan and labels on one grid, as they were fetched. `structure` has, per voxel, 0 or the place in the list + 1. */
export class Volumes {
  readonly voxelFromPatient: Affine;
  readonly centre: Vec3; // patient, mm
  readonly edges: Vec3; // of a voxel, mm
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
    this.edges = [0, 1, 2].map((c) => Math.hypot(...[0, 1, 2].map((r) => patientFromVoxel[r]![c]!))) as Vec3;
    this.size = Math.hypot(...this.edges.map((edge, i) => edge * dims[i]!));
    this.voxelSize = Math.min(...this.edges);
  }

  /** Writes places of the list of structures + 1 into a box, i fastest. */
  write(lo: Vec3, size: Vec3, bytes: Uint8Array): void {
    for (let k = 0, n = 0; k < size[2]; k++) {
      for (let j = 0; j < size[1]; j++, n += size[0]) {
        this.structure.set(bytes.subarray(n, n + size[0]), lo[0] + this.dims[0] * (lo[1] + j + this.dims[1] * (lo[2] + k)));
      }
    }
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

/** An answer's bytes, of which there are to be `size`. @param onMore  told of each piece that came */
async function bytesOf(response: Response, what: "scan" | "labels", size: number, onMore: (bytes: number) => void): Promise<ArrayBuffer> {
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

/** @param onShare  told how much of it has come, 0 to 1 */
export async function fetchVolumes(scene: Scene, shrink: 1 | 2 | 4, token: string | null, onShare: (share: number) => void): Promise<Volumes> {
  const { hash, scan, labels, dims: whole, patient_from_voxel } = scene.volume;
  const dims = whole.map((n) => Math.ceil(n / shrink)) as Vec3;
  const voxels = dims[0] * dims[1] * dims[2];
  const labelSize = labels.type === "uint8" ? 1 : 2;
  const all = voxels * (labelSize + (scan ? 2 : 0));
  let come = 0;
  const fetchBytes = async (kind: "scan" | "labels", bytesPerVoxel: number) => {
    const query = shrink > 1 ? `?shrink=${shrink}` : "";
    return bytesOf(await get(`/api/volume/${kind}/${hash}${query}`, token), kind, voxels * bytesPerVoxel, (bytes) => onShare((come += bytes) / all));
  };
  const [scanBytes, labelBytes] = await Promise.all([scan ? fetchBytes("scan", 2) : null, fetchBytes("labels", labelSize)]);

  // labels to places in the list of structures, which fit a byte
  const places = new Uint8Array(65536);
  scene.structures.slice(0, MOST_STRUCTURES).forEach((structure, place) => (places[structure.label] = place + 1));
  const raw = labels.type === "uint8" ? new Uint8Array(labelBytes) : new Uint16Array(labelBytes);
  const structure = new Uint8Array(voxels);
  await inPieces(voxels, PIECE_VOXELS, (from, to) => {
    for (let i = from; i < to; i++) structure[i] = places[raw[i]!]!;
  });

  return new Volumes(hash, shrink, dims, shrunkGrid(patient_from_voxel, [shrink, shrink, shrink]),
    scanBytes && new Int16Array(scanBytes), structure, scan?.scale ?? 1, scan?.offset ?? 0);
}

/** Windows of Hounsfield units by what they are for, as level and width. */
export const CT_PRESETS = {
  softTissue: { level: 40, width: 400 },
  bone: { level: 500, width: 2000 },
  lung: { level: -600, width: 1500 },
  brain: { level: 40, width: 80 },
  abdomen: { level: 60, width: 350 },
  angio: { level: 300, width: 600 },
} satisfies Partial<Record<keyof Words["presets"], { level: number; width: number }>>;
