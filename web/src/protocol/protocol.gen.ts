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
  "max_force_N",
  "rotation_wxyz",
] as const;
/** Switches that need the permission to change what is felt; the page shows them as check boxes. */
export const HAPTIC_SWITCHES = [
  "friction",
  "viscosity",
  "passivity",
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
export interface HeldTool {
  name: string;
  radius_mm: number;
  cuts: boolean;
  burr: string | null;
  points_mm: Vec3[];
  capsules: Capsule[];
  shaver: boolean;
}
