// An arthroscope: where it looks from the tool's tip, or from where it was moved to.

import { aboutAxis, add, cross, multiply, normalize, reject, rotate, scale, type Quaternion, type Vec3 } from "./geometry.js";

/** Of the patient: unit vectors at right angles. */
export interface ScopeFrame { eye: Vec3; forward: Vec3; right: Vec3; up: Vec3 }
/** Between the shaft and the middle of the picture, degrees: those that arthroscopes are made with. */
export const OPTICS_DEG = [0, 30, 70] as const;
/** From the middle of the picture to its border, degrees. */
export const HALF_FIELD_DEG = 40;
/** From the tip back along the shaft, mm. A scope whose camera lies at what the tool touches sees nothing but that. */
export const BACK_MM = [0, 4, 8, 15] as const;

/**
 * How far from what is touched a camera is out of the solid, with room around it or in the middle of a gap.
 * @param isClosed  whether it sees nothing so far off, mm
 * @returns at most `max_mm`; null where it is nowhere out so near
 */
export function standOff(isClosed: (off_mm: number) => boolean, max_mm: number, room_mm: number, step_mm: number): number | null {
  let begin = 0;
  while (isClosed(begin)) {
    begin += step_mm;
    if (begin > max_mm) return null;
  }
  let end = begin;
  while (end < begin + 2 * room_mm && !isClosed(end + step_mm)) end += step_mm;
  return Math.min(max_mm, begin + room_mm, (begin + end) / 2);
}

export type ScopeStand = Pick<Scope, "tool" | "optics_deg" | "back_mm" | "post_deg" | "free">;

export class Scope {
  /** Whose shaft it stands on, of the session's devices; null: nobody has said so. */
  tool: number | null = null;
  optics_deg: number = 30;
  back_mm: number = 8;
  /** How far the optics are turned about the shaft, by the light post; 0: they lean to the picture's top. */
  post_deg = 0;
  free: ScopeFrame | null = null; // where it was moved to

  get isFree(): boolean {
    return this.free !== null;
  }
  toTip(): void {
    this.free = null;
  }
  /** How it is set and where it was moved to. */
  get stand(): ScopeStand {
    const { tool, optics_deg, back_mm, post_deg, free } = this;
    return { tool, optics_deg, back_mm, post_deg, free };
  }

  /** @param axes  of the tool, in the patient: the shaft goes from the tip along the third */
  frame(tip: Vec3, axes: [Vec3, Vec3, Vec3]): ScopeFrame {
    if (this.free) return this.free;
    const [right, up, shaft] = axes;
    const forward = scale(shaft, -1);
    const post = (this.post_deg * Math.PI) / 180;
    const side = add(scale(up, Math.cos(post)), scale(right, Math.sin(post)));
    // the camera's head stays as it is held: only the optics lean
    const lean = aboutAxis(cross(forward, side), (this.optics_deg * Math.PI) / 180);
    return { eye: add(tip, scale(shaft, this.back_mm)), forward: rotate(lean, forward), right: rotate(lean, right), up: rotate(lean, up) };
  }

  turnPost(by_deg: number): void {
    this.post_deg = (((this.post_deg + by_deg) % 360) + 360) % 360;
  }
  /** Away from the tip, from how it stands there: it looks to the right and up by so much, and goes ahead. */
  move(from: ScopeFrame, right_rad: number, up_rad: number, ahead_mm: number): void {
    const turn: Quaternion = multiply(aboutAxis(from.up, -right_rad), aboutAxis(from.right, up_rad));
    const forward = normalize(rotate(turn, from.forward));
    const right = normalize(reject(rotate(turn, from.right), forward));
    this.free = { eye: add(from.eye, scale(forward, ahead_mm)), forward, right, up: cross(right, forward) };
  }
}
