// Decoding of the binary pose (docs/reference/viewer-messages.md). Positions and lengths in mm, forces in N.

import type { Quaternion, Vec3 } from "../base/geometry.js";
import { words } from "../words/words.js";

export const PROTOCOL = 3;
const HEAD_BYTES = 96;
const DEVICE_BYTES = 296;
const MAX_DEVICES = 4;
const MAX_PATH_PARTS = 6;
const MAX_CONTACTS = 6;

/** Bits of palpate::TickFlag that the page evaluates. */
export const Flag = {
  clamped: 1 << 0,
  notFinite: 1 << 1,
  outside: 1 << 2,
  paused: 1 << 3,
  contact: 1 << 4,
  thermal: 1 << 6,
  ramp: 1 << 8,
  stale: 1 << 9,
  jump: 1 << 10,
  deviceFault: 1 << 11,
  halted: 1 << 12,
  emergencyStop: 1 << 13,
  clutched: 1 << 14,
  inside: 1 << 17,
  wedged: 1 << 18,
  ruptured: 1 << 19,
  passivity: 1 << 20,
  turnHeld: 1 << 21,
  noGo: 1 << 22,
  release: 1 << 23,
  breakThrough: 1 << 24,
} as const;

/** Contribution of one structure along the penetration path. */
export interface PathPart {
  label: number;
  depth: number; // path length within the structure, mm; NaN: beyond the measured range
  share: number; // fraction of the total force, 0 to 1
}

/** Contact between a part of the tool and a structure. */
export interface Contact {
  label: number;
  part: number; // index of the tool's part, contact points before capsules
  position: Vec3; // contact point, patient
  force: number; // normal force, N
}

export interface DevicePose {
  number: number; // device number, from 0
  tip: Vec3; // patient
  proxy: Vec3; // patient; equal to the tip for direct methods
  normal: Vec3; // patient, outward; zero in free space
  orientation: Quaternion; // tool to World
  force: Vec3; // force on the hand, World
  requestedForce: number; // magnitude of the force before the output stage
  forceLimit: number;
  heat: number; // thermal load of the motors, 0 to 1
  depth: number; // penetration depth; NaN: no surface within reach
  speed: number; // tip speed, mm/s
  stiffness: number; // rendered stiffness, N/mm; 0 without contact
  flags: number;
  buttons: number;
  label: number; // label in contact; 0: none
  cuttingForce: number; // press force of a burr while it cuts, N; 0: it cuts nothing
  cuttingEnergy: number; // mean specific cutting energy of the material ahead, mJ/mm^3
  path: PathPart[]; // contributions to the force, outermost structure first
  contacts: Contact[]; // sorted by layer, outermost first, then by decreasing force
}

export interface Pose {
  sequence: number;
  tick: number;
  time: number; // session time, s
  clock: number; // server clock, s
  modelVersion: number;
  method: number;
  switches: number;
  rotation: Quaternion; // rotation of the object about the origin of World
  rate: number; // loop rate, Hz
  lateness: { p50: number; p99: number; max: number }; // lateness of ticks, us
  compute: number; // computing time of a tick, us
  skipped: number;
  dropped: number;
  stalls: number;
  devices: DevicePose[];
}

export class WireError extends Error {}
/** Error for a message of another version of the protocol. */
export class WireVersion extends WireError {}

/** @throws WireError for anything but a complete pose of this version */
export function decodePose(message: ArrayBuffer): Pose {
  const view = new DataView(message);
  if (message.byteLength < HEAD_BYTES) throw new WireError(words.shortPose(String(message.byteLength)));
  if (view.getUint32(0, true) !== 0x54504c50) throw new WireError(words.noPose);
  const version = view.getUint16(4, true);
  if (version !== PROTOCOL) throw new WireVersion(words.someOtherVersion(String(PROTOCOL)));
  const count = view.getUint8(46);
  const bytes = HEAD_BYTES + count * DEVICE_BYTES;
  if (count < 1 || count > MAX_DEVICES || view.getUint16(6, true) !== bytes || message.byteLength !== bytes) {
    throw new WireError(words.poseOfDevices(String(message.byteLength), String(count)));
  }
  const f32 = (at: number) => view.getFloat32(at, true);
  const u32 = (at: number) => view.getUint32(at, true);
  const vec3 = (at: number): Vec3 => [f32(at), f32(at + 4), f32(at + 8)];
  const quaternion = (at: number): Quaternion => [f32(at), f32(at + 4), f32(at + 8), f32(at + 12)];
  // 2^53 ticks are 28 000 years at 10 kHz
  const u64 = (at: number) => Number(view.getBigUint64(at, true));

  const devices: DevicePose[] = [];
  for (let i = 0; i < count; i++) {
    const at = HEAD_BYTES + i * DEVICE_BYTES;
    devices.push({
      number: i,
      tip: vec3(at),
      proxy: vec3(at + 12),
      normal: vec3(at + 24),
      orientation: quaternion(at + 36),
      force: vec3(at + 52),
      requestedForce: f32(at + 64),
      forceLimit: f32(at + 68),
      heat: f32(at + 72),
      depth: f32(at + 76),
      speed: f32(at + 80),
      stiffness: f32(at + 84),
      flags: u32(at + 88),
      buttons: u32(at + 92),
      label: view.getUint16(at + 96, true),
      cuttingForce: view.getUint16(at + 98, true) / 1e3,
      cuttingEnergy: f32(at + 100),
      path: Array.from({ length: MAX_PATH_PARTS }, (_, n) => at + 104 + 12 * n)
        .map((there) => ({ label: view.getUint16(there, true), depth: f32(there + 4), share: f32(there + 8) }))
        .filter(({ label }) => label !== 0),
      contacts: Array.from({ length: MAX_CONTACTS }, (_, n) => at + 176 + 20 * n)
        .map((there) => ({
          label: view.getUint16(there, true),
          part: view.getUint16(there + 2, true),
          position: vec3(there + 4),
          force: f32(there + 16),
        }))
        .filter(({ label }) => label !== 0),
    });
  }
  return {
    sequence: u64(8),
    tick: u64(16),
    time: view.getFloat64(24, true),
    clock: u64(32) / 1e9,
    modelVersion: u32(40),
    method: view.getUint8(44),
    switches: view.getUint8(45),
    rotation: quaternion(48),
    rate: f32(64),
    lateness: { p50: f32(68), p99: f32(72), max: f32(76) },
    compute: f32(80),
    skipped: u32(84),
    dropped: u32(88),
    stalls: u32(92),
    devices,
  };
}
