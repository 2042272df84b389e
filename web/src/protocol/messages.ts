// Types of the JSON messages between the page and palpate. docs/reference/viewer-protocol.md and viewer-messages.md
// describe every field; the comments here repeat only what a reader of the page's code needs.
//
// Positions and directions are in the patient's frame (LPS), lengths in mm. A label is the value of a structure's
// voxels.

import type { Affine, Vec3 } from "../base/geometry.js";
import type { ContactProperties, DeviceTool, Limits, Settings } from "./protocol.gen.js";

export type { ContactProperties, DeviceTool };

// connection

export type Role = "view" | "control" | "learner" | "teacher";
/** Permission of a viewer. */
export type Permission =
  "look" | "stop" | "unseen" | "hand" | "feel" | "plan" | "play" | "lesson" | "own_runs" | "all_runs";
/** Error reported by palpate: problem, its location, and its remedy. */
export interface Refusal {
  what: string;
  where?: string;
  how?: string;
}
export interface Request {
  type: "set" | "tissue" | "stop" | "rearm" | "pointer" | "play" | "undo" | "redo" | "task" | "plan" | "lesson";
  [value: string]: unknown;
}

// scene

/** Red, green and blue, 0 to 255. */
export type Rgb = [number, number, number];
export type Concern = "placement" | "side" | "force";

export interface Structure {
  label: number;
  name: string;
  colour: Rgb;
  tissue: number; // index in `Scene.tissues`
  within: number[]; // labels of the structures that enclose this one
}

export interface Tissue extends ContactProperties {
  name: string;
  touchable: boolean;
  protection: "none" | "alarm" | "keep"; // against a burr: "alarm" reports cuts, "keep" prevents them
  colour: Rgb;
  opacity: number;
  rests_on: number[]; // indices in Scene.tissues of the tissues that support this one
}

/**
 * No-go region: a structure (by its label), the half-space behind a plane, or a ball. A tool closer than `keep_away_mm`
 * is pushed out. Exactly one of `label`, `plane` and `ball` is not null.
 */
export interface NoGo {
  name: string;
  keep_away_mm: number;
  label: number | null;
  plane: { point_mm: Vec3; outward: Vec3 } | null;
  ball: { centre_mm: Vec3; radius_mm: number } | null;
}

export interface Scene {
  protocol: number;
  palpate: string; // version of palpate
  role: Role;
  learner: string | null;
  may: Permission[];
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
  tools: DeviceTool[]; // indexed by device number
  methods: string[];
  laws: string[]; // constitutive laws of soft tissue; empty without soft tissue
  device: {
    name: string;
    simulated: boolean;
    input: "script" | "pointer" | "ros2" | "device" | "recording";
    peak_force_N: number | null;
    continuous_force_N: number | null;
    max_stiffness_N_per_mm: number | null;
  };
  limits: Limits;
  rate_hz: number;
  recording: Recording | null; // recording that is played; null: live session
  tasks?: Task[]; // available tasks
  distances: { reach_mm: number } | null; // maximum distance to structures that is reported; null: no distances
  no_go: NoGo[];
}

export interface RecordedEvent {
  time_s: number;
  kind: "stop" | "rearm" | "settings" | "model" | "undo" | "redo";
  changed: string[];
  tissue: number | null;
  by: string;
  viewer: number | null;
}
/** Contents of the time line; times are in the recording's clock. */
export interface Recording {
  ticks: number;
  begin_s: number;
  end_s: number;
  contacts: [begin_s: number, end_s: number, label: number, max_N: number, device: number][];
  contacts_left_out: number;
  events: RecordedEvent[];
  events_left_out: number;
  force_N: number[]; // maximum force in each of equally long intervals
}

// state

export interface State extends Settings {
  law: string; // constitutive law of soft tissue
  law_awaited: string | null; // requested law whose surfaces are being computed
  law_failed: Refusal | null; // error of the latest requested law
  law_cells: { mm: number; requested_mm: number } | null; // cells of the law's solver; null: it solves none
  method_awaited: string | null; // requested method whose fields are being computed
  method_failed: Refusal | null; // error of the latest requested method
  motor_is_on: boolean; // some motor runs, by the switch or by a pedal
  strokes: { undo: number; redo: number }; // numbers of burr strokes to undo and redo; a stroke ends with the motor
  removed: { label: number; mm3: number }[]; // volume that burrs have removed from each structure
  broken_off_mm3: number; // part of it that was cut loose in fragments
  /** Minimum distance of a running burr to each protected structure, undone strokes included. */
  nearest: { label: number; mm: number }[];
  emergency_stop: boolean;
  stop: number | null; // identifier of the active stop, which a rearm refers to; null: none
  stopped_by: "you" | "viewer" | "key" | "palpate" | null;
  model_version: number;
  tissues: ContactProperties[];
  armed: boolean;
  recording: boolean;
  playback: { playing: boolean; speed: number; failed: Refusal | null } | null; // null: live session
  viewers: number;
  pointer: boolean;
  pointer_by: "you" | "viewer" | null; // viewer that moves the tip; null: none
  lesson: Lesson;
}

/** Learner with a token, as reported to a teacher. */
export interface LessonLearner {
  learner: string; // pseudonym
  here: boolean; // a page of this learner is connected
  pointer: boolean; // the learner's page moves the tip
}
/** Settings of a lesson that this viewer may know. */
export interface Lesson {
  learner: string | null; // owner of the runs; null for viewers other than teachers and that learner
  of_another: boolean; // for a learner: another learner owns the runs
  task: string | null; // only task that learners may begin; null: any
  names: boolean; // names hidden by a quiz are shown to learners
  redacted: boolean; // a quiz hides names and voxels from this viewer
  learners: LessonLearner[] | null; // learners with a token; null for viewers other than teachers
  over: boolean; // a teacher has ended the session; the server closes the connection next
}

/**
 * Straight sweep of a burr: centre of the ball at the tip at begin and end, and the ball's radius. Cylinders and cones
 * append the vector from that centre to the centre of the ball at the head's far end, and the radius of the latter.
 */
export type Sweep = [
  number,
  number,
  number,
  number,
  number,
  number,
  number,
  ...([] | [number, number, number, number]),
];

/** Registration error of a tracked tool's tip; lengths in mm. */
export interface Tracked {
  device: number;
  seen: boolean; // false: the tip is shown at its last tracked position
  fre_mm: number; // fiducial registration error
  tre_mm: number | null; // target registration error, root mean square; null: unknown
  tre_95_mm: number | null; // 95th percentile of the target registration error
  far: boolean; // the tip is far outside the fiducials
}

// plan

export interface Trajectory {
  name: string;
  entry_mm: Vec3;
  target_mm: Vec3;
  entry_within_mm: number | null; // tolerances of entry, target, angle and depth; null: none
  target_within_mm: number | null;
  angle_within_deg: number | null;
  depth_within_mm: number | null;
}
export interface Plan {
  version: number;
  saved: boolean; // the plan's file has this version
  can_change: boolean; // viewers with control may edit it
  trajectories: Trajectory[];
  keep_away: { label: number; mm: number }[];
}

// tasks

export interface TaskRegion {
  name: string;
  middle_mm: Vec3;
  radius_mm: number;
  outward: Vec3;
}
export interface TaskStep {
  name: string;
  kind: "touch" | "visit" | "cover" | "remove";
  region: number;
  force_N: [number, number | null];
  seconds: number;
  coverage: number;
  seen: boolean;
}
/** Arthroscope on the second device: angle between shaft and line of sight, distance from tip to camera. */
export interface TaskScope {
  optics_deg: number;
  back_mm: number;
}
export interface TaskForce {
  labels: number[];
  band_N: [number, number | null] | null;
  limit_N: number | null;
}
export interface TaskMetric {
  name: string;
  unit: string;
  labels: number[];
  more_is_better: boolean;
  at_least: number | null;
  at_most: number | null;
  basis: string | null;
}
export interface Task {
  name: string;
  title: string;
  briefing: string;
  quiz: boolean;
  ordered: boolean;
  ends_with_steps: boolean;
  time_limit_s: number | null;
  answer_s: number | null;
  to_find: number[]; // labels of the structures to be found in a quiz
  in_a_row: number;
  scope: TaskScope | null;
  regions: TaskRegion[];
  steps: TaskStep[];
  forces: TaskForce[];
  protected: { labels: number[]; limit_N: number }[];
  metrics: TaskMetric[];
}

export interface TaskEvent {
  kind: "step_done" | "over_limit" | "protected" | "unseen" | "ended";
  part: number;
  time_s: number;
  force_N: number;
}
/** Progress of a run of a task. */
export interface TaskProgress {
  phase: "none" | "running" | "keeping" | "over";
  run: number;
  task: string | null;
  time_s: number;
  done: boolean[]; // whether each step is complete
  share: number[]; // progress of each step, 0 to 1
  forces_N: number[];
  protected_N: number[];
  touch_N: number;
  unseen: boolean;
  missing_s: number; // total duration of dropped ticks
  events: TaskEvent[];
  events_before: number;
  keeps: boolean; // this run, or else the next one, will be stored in the records
}
/** Results of a finished run. */
export interface Debriefing {
  run: number;
  task: string;
  end: "task" | "asked" | "session" | "trouble";
  in_band: boolean;
  time_s: number;
  missing_s: number;
  ticks: number;
  first_tick: number;
  last_tick: number;
  metrics: { value: number | null; in_band: boolean; best: number | null }[];
  done: boolean[];
  events: TaskEvent[];
  more_events: number;
  /** Each: time, tip, and since the previous sample the maxima of the total force and of the task's first `forces`. */
  samples: number[][];
  patches: [number, number, number, number][]; // points of surfaces to cover: position, and 1 if covered
  patches_left_out: number;
  answer_mm: Vec3 | null;
  to_find_mm: Vec3 | null;
  runs: number;
  in_a_row: number;
  kept: number | null; // number in the records; null: not stored
  not_stored: Refusal | null;
}
