// A picture of the volume: the rays through its pixels, and the first solid surface that each of them meets.

import type { Camera } from "./camera.js";
import { dot, length, scale, sub, type Vec3 } from "./geometry.js";

/** Behind everything, 0 ... 1. */
export const BACKGROUND: Vec3 = [9 / 255, 12 / 255, 14 / 255];

/** Rays from one place instead of side by side. */
export interface Eye {
  at: Vec3; // patient
  nearest_mm: number; // what is nearer is not seen
  reach_mm: number; // of the light at the eye: so far off it is half as bright; Infinity: bright everywhere
  isRound: boolean; // the picture is a disc
}
/** What is taken away in front of a place, so that it is seen: a disc there, wider towards the viewer. */
export interface Cut {
  at: Vec3; // patient
  radius_mm: number; // of the disc
  widening: number; // mm of radius for a mm towards the viewer; Infinity: all that is in front of a plane
  kept: number; // a structure that stays: its place in the list + 1, or 0
}
/** What is seen: rays through the pixels of a picture. */
export interface View {
  width: number;
  height: number;
  corner: Vec3; // patient, of the upper left pixel's upper left corner; without an eye at any depth
  across: Vec3; // a pixel to the right
  down: Vec3; // a pixel down
  into: Vec3; // away from the viewer, unit; with an eye, in the picture's middle
  eye: Eye | null;
  cut: Cut | null;
  isFine: boolean; // surfaces are as smooth as they get
}

/** Of what a camera sees in a picture of so many pixels of the screen, drawn with `reduction` fewer. */
export function viewOf(camera: Camera, width: number, height: number, reduction: number, cut: Cut | null = null): View {
  const w = Math.max(16, Math.round(width / reduction));
  const h = Math.max(16, Math.round(height / reduction));
  const mm = camera.mmPerPixel;
  const { focus, right, up, backward, eye } = camera.inPatient();
  const corner = [0, 1, 2].map((i) => focus[i]! - (right[i]! * width * mm) / 2 + (up[i]! * height * mm) / 2) as Vec3;
  return {
    width: w, height: h, corner, across: scale(right, (width * mm) / w), down: scale(up, (-height * mm) / h), into: scale(backward, -1),
    eye: eye && { at: eye, nearest_mm: 0, reach_mm: Infinity, isRound: false }, cut, isFine: true,
  };
}

/** Of a picture: how far along each pixel's ray the first solid surface is, and of which structure. */
export class Found {
  /** @param bytes  of each pixel, row by row from the bottom: how far, of 65535, in two bytes; a structure's place + 1 */
  constructor(private readonly bytes: Uint8Array, private readonly view: View, private readonly min_mm: number, private readonly extent_mm: number) {}

  /** Where in the picture a point of the patient is, 0 ... 1, and how far along its ray; null behind the eye. */
  place(p: Vec3): { x: number; y: number; way_mm: number } | null {
    const { corner, across, down, into, eye, width, height } = this.view;
    const from = sub(p, eye ? eye.at : corner);
    const depth = dot(from, into);
    if (eye && depth <= 0) return null;
    // on the plane of the picture's corner, seen from it
    const onPlane = eye ? sub(scale(from, dot(sub(corner, eye.at), into) / depth), sub(corner, eye.at)) : from;
    return { x: dot(onPlane, across) / dot(across, across) / width, y: dot(onPlane, down) / dot(down, down) / height, way_mm: eye ? length(from) : depth };
  }
  /** @returns null where the ray meets nothing solid, or is in no picture */
  at(x: number, y: number): { way_mm: number; place: number } | null {
    const { width, height } = this.view;
    const [column, row] = [Math.floor(x * width), Math.floor(y * height)];
    if (column < 0 || row < 0 || column >= width || row >= height) return null;
    const n = 4 * (column + width * (height - 1 - row));
    const place = this.bytes[n + 2]!;
    return place === 0 ? null : { way_mm: this.min_mm + (this.extent_mm * (256 * this.bytes[n]! + this.bytes[n + 1]!)) / 65535, place: place - 1 };
  }
  /** Whether something solid lies more than `slack_mm` nearer to the viewer than a point. */
  hides(p: Vec3, slack_mm: number): boolean {
    const there = this.place(p);
    const met = there && this.at(there.x, there.y);
    return met !== null && met.way_mm < there!.way_mm - slack_mm;
  }
}
