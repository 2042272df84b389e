// Camera in World, so that the object is displayed as oriented at the device. Parallel projection, in which lengths are
// comparable; perspective on demand.

import {
  add,
  apply,
  conjugate,
  cross,
  dot,
  fitFactor,
  invert,
  multiply,
  normalize,
  reject,
  rotate,
  scale,
  sub,
  turn,
  type Affine,
  type Quaternion,
  type Vec3,
} from "../base/geometry.js";

export type Preset = "anterior" | "posterior" | "left" | "right" | "superior" | "inferior";
/** Right and up directions of the picture, patient frame. */
const PRESETS: Record<Preset, { right: Vec3; up: Vec3 }> = {
  anterior: { right: [1, 0, 0], up: [0, 0, 1] },
  posterior: { right: [-1, 0, 0], up: [0, 0, 1] },
  left: { right: [0, 1, 0], up: [0, 0, 1] },
  right: { right: [0, -1, 0], up: [0, 0, 1] },
  superior: { right: [-1, 0, 0], up: [0, -1, 0] },
  inferior: { right: [1, 0, 0], up: [0, -1, 0] },
};

/** Distance of the eye from the focus in perspective, in CSS pixels at the focus; a screen subtends 35 degrees. */
const EYE_PIXELS = 1100;

export class Camera {
  right: Vec3 = [1, 0, 0]; // unit, World
  up: Vec3 = [0, 0, 1]; // unit, World
  focus: Vec3 = [0, 0, 0]; // point at the picture's centre, World
  mmPerPixel = 0.5; // mm per CSS pixel at the focus
  isPerspective = false;
  private worldFromPatient: Affine = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 1, 0],
    [0, 0, 0, 1],
  ];
  private patientFromWorld = this.worldFromPatient;
  private rotation: Quaternion = [1, 0, 0, 0];

  setWorldFromPatient(worldFromPatient: Affine): void {
    this.worldFromPatient = worldFromPatient;
    this.patientFromWorld = invert(worldFromPatient);
  }
  /** Sets the object's rotation; differences by rounding are ignored, so that they cause no redraw. */
  setRotation(rotation: Quaternion): void {
    if (rotation.some((x, i) => Math.abs(x - this.rotation[i]!) >= 1e-6)) this.rotation = rotation;
  }

  toWorld(p: Vec3): Vec3 {
    return rotate(this.rotation, apply(this.worldFromPatient, p));
  }
  toPatient(p: Vec3): Vec3 {
    return apply(this.patientFromWorld, rotate(conjugate(this.rotation), p));
  }
  directionToPatient(v: Vec3): Vec3 {
    return turn(this.patientFromWorld, rotate(conjugate(this.rotation), v));
  }
  directionToWorld(v: Vec3): Vec3 {
    return rotate(this.rotation, turn(this.worldFromPatient, v));
  }
  /** Unit direction towards the viewer, World. */
  backward(): Vec3 {
    return cross(this.right, this.up);
  }

  /** Distance of the eye from the focus, mm, at which the scale at the focus equals that of the parallel projection. */
  get distance(): number {
    return EYE_PIXELS * this.mmPerPixel;
  }
  /** Factor by which perspective reduces the scale at a point: its depth from the eye over that of the focus. */
  shrinkOf(p: Vec3): number {
    if (!this.isPerspective) return 1;
    // positive minimum: points next to or behind the eye are projected far outside of the picture
    return (
      Math.max(this.distance - dot(sub(this.toWorld(p), this.focus), this.backward()), 1e-3 * this.distance) /
      this.distance
    );
  }
  /** Projection of a point, patient frame: CSS pixels from the centre, y down. */
  project(p: Vec3): [number, number] {
    const d = sub(this.toWorld(p), this.focus);
    const mm = this.mmPerPixel * this.shrinkOf(p);
    return [dot(d, this.right) / mm, -dot(d, this.up) / mm];
  }
  /** Ray through a pixel, patient frame, with unit direction away from the viewer. */
  ray(x: number, y: number): { from: Vec3; into: Vec3 } {
    const { focus, right, up, backward, eye } = this.inPatient();
    const on = add(focus, add(scale(right, x * this.mmPerPixel), scale(up, -y * this.mmPerPixel)));
    return eye ? { from: eye, into: normalize(sub(on, eye)) } : { from: on, into: scale(backward, -1) };
  }
  /** Point, patient frame, at a pixel and at the depth of another point. */
  unproject(x: number, y: number, depthOf: Vec3): Vec3 {
    const depth = dot(sub(this.toWorld(depthOf), this.focus), this.backward());
    const mm = this.mmPerPixel * this.shrinkOf(depthOf);
    const across = add(scale(this.right, x * mm), scale(this.up, -y * mm));
    return this.toPatient(add(add(this.focus, across), scale(this.backward(), depth)));
  }

  /** Focuses on points, patient frame, and zooms so that they just fit a picture; CSS pixels. */
  fit(points: Vec3[], width: number, height: number): void {
    this.focus = this.toWorld(scale(points.reduce(add), 1 / points.length));
    // in perspective, which changes with the scale, by successive approximation
    for (let n = 0; n < (this.isPerspective ? 4 : 1); n++)
      this.mmPerPixel *= fitFactor(
        points.map((p) => this.project(p)),
        width,
        height,
      );
  }

  /** Orients the camera to view the patient from a side, for the object's current rotation. */
  orient(preset: Preset): void {
    this.right = normalize(this.directionToWorld(PRESETS[preset].right));
    this.up = normalize(reject(this.directionToWorld(PRESETS[preset].up), this.right));
  }
  /** Orients the camera to view against a unit direction, patient frame, with superior up if possible. */
  alignView(outward: Vec3): void {
    const backward = this.directionToWorld(outward);
    if (dot(backward, backward) < 0.5) return;
    const candidates = (
      [
        [0, 0, 1],
        [0, -1, 0],
      ] as Vec3[]
    ).map((up) => reject(this.directionToWorld(up), backward));
    const up = candidates.find((one) => dot(one, one) > 0.02)!;
    this.up = normalize(up);
    this.right = normalize(cross(this.up, backward));
  }
  /** Orbits the camera about the focus, as if the object were dragged by a number of pixels. */
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

  /** Rotation, World, of an object that is dragged by a number of pixels. */
  dragged(dx: number, dy: number): Quaternion {
    const perPixel = 0.008; // rotation per pixel, rad
    const about = (axis: Vec3, angle: number): Quaternion =>
      [Math.cos(angle / 2), ...scale(axis, Math.sin(angle / 2))] as Quaternion;
    return multiply(about(this.up, dx * perPixel), about(this.right, dy * perPixel));
  }

  /** Pose relative to the patient; eye: null in parallel projection. */
  inPatient(): { focus: Vec3; right: Vec3; up: Vec3; backward: Vec3; eye: Vec3 | null } {
    return {
      focus: this.toPatient(this.focus),
      eye: this.isPerspective ? this.toPatient(add(this.focus, scale(this.backward(), this.distance))) : null,
      right: this.directionToPatient(this.right),
      up: this.directionToPatient(this.up),
      backward: this.directionToPatient(this.backward()),
    };
  }
  copy(): Camera {
    return Object.assign(new Camera(), this);
  }
}
