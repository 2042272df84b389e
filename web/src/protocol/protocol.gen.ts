// Types of the protocol that palpate derives from its tables of settings, contact properties and tools.
// Written by PALPATE_UPDATE_DOCS=1 server_test --gtest_filter='ProtocolTypes.*', not by hand.

import type { Quaternion, Vec3 } from "../base/geometry.js";

/** Settings that a tick reads, as in `set` and `state`. */
export interface Settings {
  method: string;
  friction: boolean;
  viscosity: boolean;
  passivity: boolean;
  paused: boolean;
  motor: boolean;
  vibration: boolean;
  max_force_N: number;
  rotation_wxyz: Quaternion;
}
export const SETTING_NAMES = [
  "method",
  "friction",
  "viscosity",
  "passivity",
  "paused",
  "motor",
  "vibration",
  "max_force_N",
  "rotation_wxyz",
] as const;
/** Switches that need the permission to change contact settings; the page shows them as check boxes. */
export const HAPTIC_SWITCHES = [
  "friction",
  "viscosity",
  "passivity",
  "vibration",
] as const;

/** Properties of a tissue that may change during a session, as in `tissue`. */
export interface ContactProperties {
  stiffness_N_per_mm: number;
  static_friction: number;
  friction: number;
  viscosity_N_s_per_mm: number;
}

/** Permitted values: the range of the force limit, and that of each contact property. */
export interface Limits extends Record<keyof ContactProperties, [number, number]> {
  max_force_N: number;
  min_max_force_N: number;
  max_max_force_N: number;
}

/** Convex hull of two balls, in the tool's frame. */
export interface Capsule {
  from_mm: Vec3;
  to_mm: Vec3;
  radius_mm: number;
  end_radius_mm: number;
}

/** Tool held by one device, in the tool's frame. */
export interface DeviceTool {
  name: string;
  radius_mm: number;
  cuts: boolean;
  burr: string | null;
  points_mm: Vec3[];
  capsules: Capsule[];
  shaver: boolean;
  revolutions_per_s: number;
  flutes: number;
}

/** Numbers of each tick in a bundle (`PLPB`). */
export const BUNDLED_TICK = {
  tick: { offset: 0, type: "u64", count: 1 },
  time_s: { offset: 8, type: "f64", count: 1 },
  model_version: { offset: 16, type: "u32", count: 1 },
  devices: { offset: 20, type: "u32", count: 1 },
  rotation_wxyz: { offset: 24, type: "f32", count: 4 },
} as const;
export const BUNDLED_TICK_BYTES = 40;
/** Numbers of each of its devices, which follow it. */
export const BUNDLED_DEVICE = {
  tip_patient_mm: { offset: 0, type: "f32", count: 3 },
  proxy_patient_mm: { offset: 12, type: "f32", count: 3 },
  orientation_wxyz: { offset: 24, type: "f32", count: 4 },
  force_N: { offset: 40, type: "f32", count: 3 },
  unclamped_force_N: { offset: 52, type: "f32", count: 1 },
  depth_mm: { offset: 56, type: "f32", count: 1 },
  flags: { offset: 60, type: "u32", count: 1 },
  buttons: { offset: 64, type: "u32", count: 1 },
  label: { offset: 68, type: "u32", count: 1 },
} as const;
export const BUNDLED_DEVICE_BYTES = 72;
