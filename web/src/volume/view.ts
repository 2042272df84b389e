// View of the volume: rays through pixels, and the depth of the first solid surface along each.

import type { Camera } from "./camera.js";
import { dot, length, scale, sub, type Vec3 } from "../base/geometry.js";

/** Background colour, 0 to 1. */
export const BACKGROUND: Vec3 = [9 / 255, 12 / 255, 14 / 255];

/** Eye of a perspective view. */
export interface Eye {
  at: Vec3; // position, patient
  nearest_mm: number; // near clipping distance
  reach_mm: number; // distance at which the light at the eye has halved; Infinity: constant
  isRound: boolean; // circular field of view
}
/** Clipped region in front of a position: a cone that begins as a disc and widens towards the viewer. */
export interface Cut {
  at: Vec3; // centre of the disc, patient
  radius_mm: number; // radius of the disc
  widening: number; // increase of the radius per distance towards the viewer; Infinity: half-space
  unclipped: number; // structure that is not clipped: its index + 1, or 0
}
/** Rays through the pixels of a picture; patient frame. */
export interface View {
  width: number;
  height: number;
  corner: Vec3; // top left corner of the top left pixel; without an eye at arbitrary depth
  across: Vec3; // displacement by one pixel to the right
  down: Vec3; // displacement by one pixel down
  into: Vec3; // unit direction away from the viewer; with an eye, at the picture's centre
  eye: Eye | null;
  cut: Cut | null;
  isFine: boolean; // smoothest surfaces, as at rest
}

/**
 * View of a camera.
 * @param reduction  CSS pixels per picture pixel
 */
export function viewOf(camera: Camera, width: number, height: number, reduction: number, cut: Cut | null = null): View {
  const w = Math.max(16, Math.round(width / reduction));
  const h = Math.max(16, Math.round(height / reduction));
  const mm = camera.mmPerPixel;
  const { focus, right, up, backward, eye } = camera.inPatient();
  const corner = [0, 1, 2].map((i) => focus[i]! - (right[i]! * width * mm) / 2 + (up[i]! * height * mm) / 2) as Vec3;
  return {
    width: w,
    height: h,
    corner,
    across: scale(right, (width * mm) / w),
    down: scale(up, (-height * mm) / h),
    into: scale(backward, -1),
    eye: eye && { at: eye, nearest_mm: 0, reach_mm: Infinity, isRound: false },
    cut,
    isFine: true,
  };
}

/** Depth map: depth and structure of the first solid surface along each pixel's ray. */
export class Found {
  /** @param bytes  rows from the bottom: depth in two bytes, as a fraction of 65535; index of the structure + 1 */
  constructor(
    private readonly bytes: Uint8Array,
    private readonly view: View,
    private readonly min_mm: number,
    private readonly extent_mm: number,
  ) {}

  /** Position of a point in the picture, 0 to 1, and its depth along the ray, mm; null: behind the eye. */
  project(p: Vec3): { x: number; y: number; way_mm: number } | null {
    const { corner, across, down, into, eye, width, height } = this.view;
    const from = sub(p, eye ? eye.at : corner);
    const depth = dot(from, into);
    if (eye && depth <= 0) return null;
    // intersection of the point's ray with the picture's plane
    const onPlane = eye ? sub(scale(from, dot(sub(corner, eye.at), into) / depth), sub(corner, eye.at)) : from;
    return {
      x: dot(onPlane, across) / dot(across, across) / width,
      y: dot(onPlane, down) / dot(down, down) / height,
      way_mm: eye ? length(from) : depth,
    };
  }
  /** Depth and structure at a position in the picture, 0 to 1; null: no solid, or outside of the picture. */
  at(x: number, y: number): { way_mm: number; structure: number } | null {
    const { width, height } = this.view;
    const [column, row] = [Math.floor(x * width), Math.floor(y * height)];
    if (column < 0 || row < 0 || column >= width || row >= height) return null;
    const n = 4 * (column + width * (height - 1 - row));
    const structure = this.bytes[n + 2]!;
    return structure === 0
      ? null
      : {
          way_mm: this.min_mm + (this.extent_mm * (256 * this.bytes[n]! + this.bytes[n + 1]!)) / 65535,
          structure: structure - 1,
        };
  }
  /** Whether a solid surface is more than `slack_mm` in front of a point. */
  hides(p: Vec3, slack_mm: number): boolean {
    const there = this.project(p);
    const met = there && this.at(there.x, there.y);
    return met !== null && met.way_mm < there!.way_mm - slack_mm;
  }
}
