// Arthroscope: pose of its camera, on the tool's shaft or moved away from it.

import {
  aboutAxis,
  add,
  cross,
  multiply,
  normalize,
  reject,
  rotate,
  scale,
  type Quaternion,
  type Vec3,
} from "../base/geometry.js";

/** Pose of a camera: position, mm, and orthonormal directions; patient frame. */
export interface ScopeFrame {
  eye: Vec3;
  forward: Vec3;
  right: Vec3;
  up: Vec3;
}
/** Angles between shaft and line of sight of real arthroscopes, degrees. */
export const OPTICS_DEG = [0, 30, 70] as const;
/** Half angle of view, degrees. */
export const HALF_FIELD_DEG = 40;
/** Distances of the camera behind the tip along the shaft, mm. At 0, a surface in contact fills the view. */
export const BACK_MM = [0, 4, 8, 15] as const;

/**
 * Distance of the camera from the contact, outside of solids: with clearance `room_mm`, or at the middle of a gap.
 * @param isClosed  whether the view is blocked at a distance from the contact, mm
 * @returns at most `max_mm`; null if it is blocked everywhere up to there
 */
export function standOff(
  isClosed: (off_mm: number) => boolean,
  max_mm: number,
  room_mm: number,
  step_mm: number,
): number | null {
  let begin = 0;
  while (isClosed(begin)) {
    begin += step_mm;
    if (begin > max_mm) return null;
  }
  let end = begin;
  while (end < begin + 2 * room_mm && !isClosed(end + step_mm)) end += step_mm;
  return Math.min(max_mm, begin + room_mm, (begin + end) / 2);
}

export type ScopePlacement = Pick<Scope, "tool" | "optics_deg" | "back_mm" | "post_deg" | "free">;

export class Scope {
  /** Number of the device that holds the scope; null: the default device. */
  tool: number | null = null;
  optics_deg: number = 30;
  back_mm: number = 8;
  /** Rotation of the optics about the shaft, by the light post, degrees; 0: tilted towards the picture's top. */
  post_deg = 0;
  free: ScopeFrame | null = null; // pose after the camera was moved off the shaft; null: on the shaft

  get isFree(): boolean {
    return this.free !== null;
  }
  toTip(): void {
    this.free = null;
  }
  /** Undoable state: settings and free pose. */
  get placement(): ScopePlacement {
    const { tool, optics_deg, back_mm, post_deg, free } = this;
    return { tool, optics_deg, back_mm, post_deg, free };
  }

  /**
   * Pose of the camera.
   * @param tip  position of the tip, patient frame
   * @param axes  axes of the tool, patient frame; the third one points from the tip along the shaft
   */
  frame(tip: Vec3, axes: [Vec3, Vec3, Vec3]): ScopeFrame {
    if (this.free) return this.free;
    const [right, up, shaft] = axes;
    const forward = scale(shaft, -1);
    const post = (this.post_deg * Math.PI) / 180;
    const side = add(scale(up, Math.cos(post)), scale(right, Math.sin(post)));
    // the optics rotate, the camera head keeps its orientation
    const tilt = aboutAxis(cross(forward, side), (this.optics_deg * Math.PI) / 180);
    return {
      eye: add(tip, scale(shaft, this.back_mm)),
      forward: rotate(tilt, forward),
      right: rotate(tilt, right),
      up: rotate(tilt, up),
    };
  }

  turnPost(by_deg: number): void {
    this.post_deg = (((this.post_deg + by_deg) % 360) + 360) % 360;
  }
  /** Moves the camera off the shaft, from a pose: rotates right and up, and advances. */
  move(from: ScopeFrame, right_rad: number, up_rad: number, ahead_mm: number): void {
    const turn: Quaternion = multiply(aboutAxis(from.up, -right_rad), aboutAxis(from.right, up_rad));
    const forward = normalize(rotate(turn, from.forward));
    const right = normalize(reject(rotate(turn, from.right), forward));
    this.free = { eye: add(from.eye, scale(forward, ahead_mm)), forward, right, up: cross(right, forward) };
  }
}
