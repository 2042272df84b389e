// A parallel view of the World, in which the object is turned as it is felt. Parallel, so that lengths can be compared
// and left is left everywhere in the picture.

import {
  add, apply, conjugate, cross, dot, invert, multiply, normalize, reject, rotate, scale, sub, turn,
  type Affine, type Quaternion, type Vec3,
} from "./geometry.js";

export type Preset = "anterior" | "posterior" | "left" | "right" | "superior" | "inferior";
/** Where the picture's right and top point to in the patient. */
const PRESETS: Record<Preset, { right: Vec3; up: Vec3 }> = {
  anterior: { right: [1, 0, 0], up: [0, 0, 1] },
  posterior: { right: [-1, 0, 0], up: [0, 0, 1] },
  left: { right: [0, 1, 0], up: [0, 0, 1] },
  right: { right: [0, -1, 0], up: [0, 0, 1] },
  superior: { right: [-1, 0, 0], up: [0, -1, 0] },
  inferior: { right: [1, 0, 0], up: [0, -1, 0] },
};

export class Camera {
  right: Vec3 = [1, 0, 0]; // World, unit
  up: Vec3 = [0, 0, 1]; // World, unit
  focus: Vec3 = [0, 0, 0]; // World, in the middle of the picture
  mmPerPixel = 0.5;
  private worldFromPatient: Affine = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
  private patientFromWorld = this.worldFromPatient;
  private felt: Quaternion = [1, 0, 0, 0];

  place(worldFromPatient: Affine): void {
    this.worldFromPatient = worldFromPatient;
    this.patientFromWorld = invert(worldFromPatient);
  }
  /** @returns whether the object stands otherwise than before */
  setRotation(felt: Quaternion): boolean {
    const same = felt.every((x, i) => Math.abs(x - this.felt[i]!) < 1e-6);
    if (!same) this.felt = felt;
    return !same;
  }

  toWorld(p: Vec3): Vec3 {
    return rotate(this.felt, apply(this.worldFromPatient, p));
  }
  toPatient(p: Vec3): Vec3 {
    return apply(this.patientFromWorld, rotate(conjugate(this.felt), p));
  }
  directionToPatient(v: Vec3): Vec3 {
    return turn(this.patientFromWorld, rotate(conjugate(this.felt), v));
  }
  directionToWorld(v: Vec3): Vec3 {
    return rotate(this.felt, turn(this.worldFromPatient, v));
  }
  /** Towards the viewer, World. */
  backward(): Vec3 {
    return cross(this.right, this.up);
  }

  /** In pixels from the middle, y downwards. */
  project(p: Vec3): [number, number] {
    const d = sub(this.toWorld(p), this.focus);
    return [dot(d, this.right) / this.mmPerPixel, -dot(d, this.up) / this.mmPerPixel];
  }
  /** The patient's point at a pixel, as deep in the picture as `depthOf` is. */
  unproject(x: number, y: number, depthOf: Vec3): Vec3 {
    const depth = dot(sub(this.toWorld(depthOf), this.focus), this.backward());
    const across = add(scale(this.right, x * this.mmPerPixel), scale(this.up, -y * this.mmPerPixel));
    return this.toPatient(add(add(this.focus, across), scale(this.backward(), depth)));
  }

  /** Looks at the patient from a side, as the object stands now. */
  look(preset: Preset): void {
    this.right = normalize(this.directionToWorld(PRESETS[preset].right));
    this.up = normalize(reject(this.directionToWorld(PRESETS[preset].up), this.right));
  }
  /** The camera goes round the focus as if the object were dragged by so many pixels. */
  orbit(dx: number, dy: number): void {
    const turned = this.dragged(-dx, -dy);
    this.right = normalize(rotate(turned, this.right));
    this.up = normalize(reject(rotate(turned, this.up), this.right));
  }
  pan(dx: number, dy: number): void {
    this.focus = add(this.focus, add(scale(this.right, -dx * this.mmPerPixel), scale(this.up, dy * this.mmPerPixel)));
  }
  zoom(factor: number): void {
    this.mmPerPixel = Math.min(5, Math.max(0.01, this.mmPerPixel / factor));
  }

  /** The rotation in World that turns an object in this view with a drag by so many pixels. */
  dragged(dx: number, dy: number): Quaternion {
    const perPixel = 0.008; // rad
    const about = (axis: Vec3, angle: number): Quaternion =>
      [Math.cos(angle / 2), ...scale(axis, Math.sin(angle / 2))] as Quaternion;
    return multiply(about(this.up, dx * perPixel), about(this.right, dy * perPixel));
  }

  /** What vtk.js wants: everything in the patient's frame. */
  inPatient(): { position: Vec3; focus: Vec3; up: Vec3 } {
    const distance = 1000; // mm; any that is in front of everything
    return {
      position: this.toPatient(add(this.focus, scale(this.backward(), distance))),
      focus: this.toPatient(this.focus),
      up: this.directionToPatient(this.up),
    };
  }
}
