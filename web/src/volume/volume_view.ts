// Picture of the volume in the object's orientation, with the tool as an overlay. The volume is rendered when its
// appearance changes, in a worker (volume_renderer.ts); tool, trail and force are drawn over it for every pose.

import { Camera, type Preset } from "./camera.js";
import type { History } from "../state/history.js";
import {
  dot,
  length,
  orientationLetters,
  scale,
  sub,
  multiply,
  normalizeQuaternion,
  spread,
  type Plane,
  type Quaternion,
  type Vec3,
} from "../base/geometry.js";
import { boxSection, drawHeight, drawPlane, drawShaft, type InVolume } from "../drawing/in_volume.js";
import { LivePicture } from "./live_picture.js";
import {
  drawAge,
  drawCube,
  drawForceBar,
  drawLetters,
  drawScale,
  drawSide,
  drawTool,
  drawTrail,
  text,
  touchedText,
  type Frame,
  type Projection,
} from "../drawing/overlay.js";
import { drawNoGoInVolume, drawNoGoWarning } from "../drawing/no_go_marks.js";
import { Picture } from "../drawing/picture.js";
import { drawPlanInVolume } from "../drawing/plan_marks.js";
import type { PointerDevice } from "../state/pointer.js";
import { Touching } from "../touch/touching.js";
import { memory_GB } from "../base/screen.js";
import type { Memory } from "../protocol/scene.js";
import type { Session } from "../state/session.js";
import { firstTouchable, SurfaceBelowTool } from "../touch/surface.js";
import { BACKGROUND, viewOf, type Cut, type View } from "./view.js";
import type { VolumeRenderer } from "./volume_renderer.js";
import { Flag, type DevicePose } from "../protocol/wire.js";
import { words } from "../words/words.js";

/** Interval of rotation requests, between which the loop interpolates. */
const ROTATION_INTERVAL_MS = 100;
/** Maximum number of texels without a graphics card, for interactive rates. */
const SOFTWARE_TEXELS = 1.2e6;
/** Maximum height above a surface at which a tool's height is displayed. */
const MAX_HEIGHT_MM = 20;
/** Clipping in front of the tip: none, a half-space, or a hole that widens towards the viewer. */
export type Cutting = "none" | "plane" | "hole";
const HOLE_RADIUS_MM = 8;
const HOLE_WIDENING = 0.4;

/** Pose of the camera in World, mm, and extent across the picture's shorter side. */
interface CameraPlacement {
  right: Vec3;
  up: Vec3;
  focus: Vec3;
  across_mm: number;
}

export class VolumeView {
  readonly picture = new Picture("volume");
  readonly camera = new Camera();
  turnsObject = false; // drags rotate the object instead of the camera
  cutting: Cutting = "none";
  isWhole = false; // full resolution without a graphics card, too
  /** Returns the planes whose outlines are drawn in the volume. */
  planes: () => { plane: Plane; colour: string }[] = () => [];
  showsPlanes = false;
  /** Draws further overlays, below the tool. */
  drawMarks: (frame: Frame, seen: Projection & InVolume) => void = () => {};
  private readonly live: LivePicture<Camera>;
  private ground: SurfaceBelowTool | null = null;
  private overlayDrawn_ms = -Infinity; // time of the latest drawing of the tool
  private size = 0; // shorter side of the picture, CSS pixels; 0: never shown
  private rotation: Quaternion | null = null; // target of the rotation by the current drag; null: none
  private rotationSent: Quaternion | null = null;
  private gesture = 0; // undo group of rotations and camera movements
  private corners: Vec3[] = []; // corners of the object's box, patient frame
  private fitted = NaN; // scale at which the object was fitted into the picture, until the user changes it
  private isCameraPlaced = false; // the camera has been placed, by default or by the user
  private readonly touching: Touching;
  private isPlanning = false; // the current press creates or moves a trajectory
  private readonly pointers = new Map<number, [number, number]>();

  constructor(
    private readonly session: Session,
    private readonly renderer: VolumeRenderer,
    readonly isSoftware: boolean,
    private readonly maxSide: number,
    private readonly pointer: PointerDevice,
    private readonly history: History,
    private readonly turnTo: (rotation: Quaternion, gesture: number) => void,
  ) {
    this.live = new LivePicture(this.picture, renderer, isSoftware, false, () => this.drawOver());
    this.touching = new Touching(
      session,
      pointer,
      // the first unclipped surface with contact forces
      (at, stroke) =>
        stroke.surfaceAlong(
          this.rayAt(at),
          (p) => this.touching.isTouchable(p) && !this.isClipped(p),
          this.camera.isPerspective ? 0 : -Infinity,
        ),
      (at, end) => this.patientAt(at, end),
      () => words.nothingThere,
    );
    history.register(
      "camera",
      () => this.placement,
      (to) => (this.placement = to),
    );
    this.listen();
    window.setInterval(() => this.sendRotation(), ROTATION_INTERVAL_MS);
  }

  /** Limits of the volume's texture, which takes 6 bytes per texel on the graphics card and as many in the worker. */
  private get memory(): Memory {
    const memory = memory_GB();
    const most = memory <= 2 ? 2e6 : memory <= 4 ? 8e6 : 64e6;
    return { maxTexels: this.isSoftware && !this.isWhole ? SOFTWARE_TEXELS : most, maxSide: this.maxSide };
  }
  /** Loads the volume into the renderer. */
  load(): void {
    if (this.session.volumes.value) this.renderer.load(this.session.volumes.value, this.memory);
  }

  sceneChanged(): void {
    this.camera.setWorldFromPatient(this.session.scene.value!.world_from_patient);
    this.isCameraPlaced = false;
    this.ground = new SurfaceBelowTool(this.session.volumes.value!, MAX_HEIGHT_MM);
    this.corners = this.session.volumes.value!.objectCorners;
    this.load();
    this.reset();
  }
  lost(): void {
    this.live.lost();
  }
  /** Shows the whole object from the anterior side. */
  reset(): void {
    const volumes = this.session.volumes.value,
      pose = this.session.pose.value;
    if (!volumes) return;
    if (pose) this.camera.setRotation(pose.rotation);
    this.camera.orient("anterior");
    this.fit();
  }
  private fit(): void {
    const { clientWidth, clientHeight } = this.picture.surface;
    if (clientWidth > 0 && this.corners.length > 0) this.camera.fit(this.corners, clientWidth, clientHeight);
    this.fitted = this.camera.mmPerPixel;
  }
  /** Extent across the shorter side of the picture, mm; 0: never shown. */
  get across_mm(): number {
    return this.camera.mmPerPixel * this.size;
  }
  set across_mm(mm: number) {
    const { clientWidth, clientHeight } = this.picture.surface;
    // a hidden picture has no size: keeps the previous one
    this.size = Math.min(clientWidth, clientHeight) || this.size;
    if (this.size > 0 && mm > 0) this.camera.mmPerPixel = mm / this.size;
  }
  orient(preset: Preset): void {
    this.moveCamera(() => this.camera.orient(preset));
  }
  /**
   * Orients and zooms the camera to a region of a given radius; patient frame.
   * @param outward  unit direction towards the camera; [0, 0, 0]: current direction
   * @param isNoted  the change is an undo step
   */
  focusOn(centre: Vec3, radius_mm: number, outward: Vec3, isNoted: boolean): void {
    const { camera, session } = this;
    if (!session.volumes.value) return;
    const move = () => {
      if (session.pose.value) camera.setRotation(session.pose.value.rotation);
      camera.alignView(outward);
      camera.focus = camera.toWorld(centre);
      this.across_mm = Math.min(0.7 * session.volumes.value!.size, Math.max(5 * radius_mm, 60));
    };
    if (isNoted) return this.moveCamera(move);
    move();
    this.isCameraPlaced = true;
  }
  /**
   * Changes the camera, undoably.
   * @param gesture  changes with equal `by` and gesture are one undo step
   */
  private moveCamera(move: () => void, gesture = ++this.history.gesture, by = "camera"): void {
    this.isCameraPlaced = true;
    this.history.change(by, move, gesture);
  }

  get placement(): CameraPlacement {
    const {
      camera: { right, up, focus },
      across_mm,
    } = this;
    return { right, up, focus, across_mm };
  }
  set placement({ right, up, focus, across_mm }: CameraPlacement) {
    this.isCameraPlaced = true;
    Object.assign(this.camera, { right, up, focus });
    this.across_mm = across_mm;
  }

  /**
   * Requests a picture if needed, and draws the tool over the displayed one.
   * @param min_ms  minimum interval between drawings of the tool
   */
  draw(now: number, min_ms = 0): void {
    if (this.requestPicture(now) && (min_ms === 0 || now - this.overlayDrawn_ms > min_ms)) this.drawOver();
  }
  /**
   * Requests a picture if needed.
   * @returns whether the picture is visible
   */
  requestPicture(now: number): boolean {
    const { session, picture, camera } = this;
    const resized = picture.fit();
    if (!picture.isShown || !session.volumes.value || !session.scene.value) return false;
    if (resized) {
      this.overlayDrawn_ms = -Infinity;
      this.live.show();
      // keeps the extent when the picture's size changes
      const size = Math.min(picture.surface.clientWidth, picture.surface.clientHeight);
      if (this.size === 0) this.reset();
      else if (camera.mmPerPixel === this.fitted) this.fit();
      else camera.mmPerPixel *= this.size / size;
      this.size = size;
    }
    if (session.pose.value) camera.setRotation(session.pose.value.rotation);
    if (session.pose.value && !this.isCameraPlaced) {
      // initial placement, as soon as the object's rotation is known
      this.isCameraPlaced = true;
      this.reset();
    }
    const frame = picture.frame();

    this.renderer.follow(session);
    const cut = this.cut();
    const key = JSON.stringify([
      camera.inPatient(),
      camera.mmPerPixel,
      frame.width,
      frame.height,
      this.renderer.version,
      cut,
    ]);
    this.live.update(now, key, this.pointers.size > 0, () => ({
      camera: camera.copy(),
      view: (reduction) => viewOf(camera, frame.width / frame.ratio, frame.height / frame.ratio, reduction, cut),
    }));
    return true;
  }

  /** Clipped region for the current position of the tool; null: none. */
  private cut(): Cut | null {
    const { session, cutting } = this;
    const device = session.pose.value?.devices[0];
    if (!device || cutting === "none") return null;
    const at = session.toolAt(device);
    if (cutting === "plane") return { at, radius_mm: 0, widening: Infinity, unclipped: 0 };
    return {
      at,
      radius_mm: HOLE_RADIUS_MM,
      widening: HOLE_WIDENING,
      unclipped: session.scene.value!.structures.findIndex(({ label }) => label === device.label) + 1,
    };
  }
  private isClipped(p: Vec3): boolean {
    const cut = this.cut();
    if (!cut) return false;
    const { eye, backward } = this.camera.inPatient();
    const towards = eye ? scale(sub(eye, cut.at), 1 / length(sub(eye, cut.at))) : backward;
    const from = sub(p, cut.at);
    const height = dot(from, towards);
    return (
      height > 0 &&
      length(sub(from, scale(towards, height))) < cut.radius_mm + cut.widening * height &&
      this.session.volumes.value!.structureAt(p) !== cut.unclipped - 1
    );
  }

  /** Camera of the displayed picture, or the current one before there is any. */
  private get shown(): Camera {
    return this.live.latest?.camera ?? this.camera;
  }
  private projection(): Projection & InVolume {
    const { width, height, ratio } = this.picture.frame();
    const camera = this.shown;
    const pixelRatio = ratio * this.live.scale;
    const pixelsPerMm = (p: Vec3) => pixelRatio / camera.mmPerPixel / camera.shrinkOf(p);
    return {
      pixel: (p) => {
        const [x, y] = camera.project(p);
        return [width / 2 + x * pixelRatio, height / 2 + y * pixelRatio];
      },
      direction: (v) => {
        const world = camera.directionToWorld(v);
        return [dot(world, camera.right), -dot(world, camera.up)];
      },
      pixelsPerMm,
      clearness: () => 1,
      hides: (p, slack_mm) => this.live.latest?.found.hides(p, slack_mm) === true,
    };
  }
  get isSharp(): boolean {
    return this.live.isSharp;
  }
  /** Projection of a point into the displayed picture, canvas pixels. */
  pixelOf(p: Vec3): [number, number] {
    return this.projection().pixel(p);
  }
  /** Updates the picture after a change of voxels. */
  voxelsChanged(): void {
    this.ground?.forget();
  }

  /** Draws the tool, dashed where occluded, and in free space its height above the surface. */
  private drawToolIn(projection: Projection & InVolume, device: DevicePose): void {
    const { session } = this;
    const frame = this.picture.frame();
    const tool = session.toolAt(device);
    const { radius_mm } = session.toolOf(device);
    // tolerance for the smoothing of the surface on which the tool lies
    const slack_mm = radius_mm + 1.5 * session.volumes.value!.voxelSize;
    const ground =
      device.flags & (Flag.contact | Flag.inside)
        ? null
        : this.ground!.belowTool(device.number, tool, this.touching.isTouchable);
    if (ground && ground.height_mm > radius_mm) drawHeight(frame, projection, tool, ground, radius_mm);
    drawTool(frame, session, device, {
      ...projection,
      clearness: () => (projection.hides(tool, slack_mm) ? 0.45 : 1),
      hasBodies: true,
      capsule: (from, to, radii_mm, colour) =>
        drawShaft(frame, projection, from, to, radii_mm, colour, 1.5 * session.volumes.value!.voxelSize),
    });
  }

  private drawOver(): void {
    this.overlayDrawn_ms = performance.now();
    const { session } = this;
    const frame = this.picture.frame();
    const projection = this.projection();
    frame.context.clearRect(0, 0, frame.width, frame.height);
    drawNoGoInVolume(frame, projection, session, session.volumes.value!);
    drawPlanInVolume(frame, projection, session.plans);
    this.drawMarks(frame, projection);
    const device = session.pose.value?.devices[0];
    if (device) {
      for (const { plane, colour } of this.showsPlanes ? this.planes() : [])
        drawPlane(frame, projection, boxSection(plane, session.volumes.value!), colour);
      drawTrail(frame, session, projection);
      for (const each of session.drawn) this.drawToolIn(projection, each);
      text(
        frame,
        touchedText(session, device),
        12 * frame.ratio,
        40 * frame.ratio,
        12,
        session.isFresh.value ? "#eef3f5" : "#a4adb3",
        "left",
        "top",
      );
      if (session.scene.value!.device.input === "pointer") drawForceBar(frame, session, device);
    }
    const camera = this.shown;
    const right = camera.directionToPatient(camera.right);
    const down = scale(camera.directionToPatient(camera.up), -1);
    drawLetters(frame, orientationLetters(right, down), session.scene.value!.oriented, true);
    if (session.scene.value!.oriented) {
      drawCube(frame, (v) => {
        const world = camera.directionToWorld(v);
        return [dot(world, camera.right), dot(world, camera.up), dot(world, camera.backward())];
      });
    }
    // perspective has no common scale
    if (!camera.isPerspective) drawScale(frame, camera.mmPerPixel / frame.ratio / this.live.scale);
    drawSide(frame, session.scene.value!);
    drawNoGoWarning(frame, session, 60);
    drawAge(frame, session);
  }

  private async viewAt(width: number, height: number, mmPerPixel: number): Promise<View> {
    await this.renderer.loaded;
    this.renderer.follow(this.session);
    const camera = this.camera.copy();
    camera.mmPerPixel = mmPerPixel;
    return viewOf(camera, width, height, 1, this.cut());
  }
  /**
   * Full-size picture of the volume: RGBA by rows from the top.
   * @param isFine  smooth surfaces, as at rest
   */
  async pixels(width: number, height: number, mmPerPixel: number, isFine = true): Promise<Uint8ClampedArray> {
    return this.renderer.pixels({ ...(await this.viewAt(width, height, mmPerPixel)), isFine });
  }
  /** Mask of a picture's pixels: 1 where a press would hit a solid. */
  async hitMask(width: number, height: number, mmPerPixel: number): Promise<number[]> {
    const { bitmap, found } = await this.renderer.drawn({
      ...(await this.viewAt(width, height, mmPerPixel)),
      isFine: true,
    });
    bitmap.close();
    return Array.from({ length: width * height }, (_, n) =>
      found.at(((n % width) + 0.5) / width, (Math.floor(n / width) + 0.5) / height) ? 1 : 0,
    );
  }
  /** Mask of a picture's pixels: 1 where the volume covers the background. */
  async silhouette(
    width: number,
    height: number,
    mmPerPixel: number,
  ): Promise<{ width: number; height: number; seen: number[] }> {
    const data = await this.pixels(width, height, mmPerPixel);
    const ground = BACKGROUND.map((x) => Math.round(255 * x));
    const seen = Array.from({ length: width * height }, (_, i) =>
      [0, 1, 2].some((c) => Math.abs(data[4 * i + c]! - ground[c]!) > 28) ? 1 : 0,
    );
    return { width, height, seen };
  }

  private turnObject(dx: number, dy: number): void {
    const now = this.rotation ?? this.session.pose.value?.rotation ?? [1, 0, 0, 0];
    this.rotation = normalizeQuaternion(multiply(this.camera.dragged(dx, dy), now));
  }
  private sendRotation(): void {
    if (!this.rotation || this.rotation === this.rotationSent) return;
    this.rotationSent = this.rotation;
    this.turnTo(this.rotation, this.gesture);
    // the next drag starts from the object's current rotation
    if (this.pointers.size === 0) this.rotation = null;
  }
  private rayAt(at: [number, number]): { from: Vec3; into: Vec3 } {
    const { width, height, ratio } = this.picture.frame();
    return this.camera.ray((at[0] - width / 2) / ratio, (at[1] - height / 2) / ratio);
  }
  private patientAt(at: [number, number], depthOf: Vec3): Vec3 {
    const { width, height, ratio } = this.picture.frame();
    return this.camera.unproject((at[0] - width / 2) / ratio, (at[1] - height / 2) / ratio, depthOf);
  }

  /** Position on the first visible, unclipped surface under a press; null: none. */
  private shownUnder(at: [number, number]): Vec3 | null {
    const appearances = this.session.appearances.value,
      volumes = this.session.volumes.value;
    const { from, into } = this.rayAt(at);
    const isShown = (p: Vec3): boolean => {
      const structure = volumes!.structureAt(p);
      return structure !== null && appearances[structure]?.visible === true && !this.isClipped(p);
    };
    return firstTouchable(volumes!, isShown, from, into, this.camera.isPerspective ? 0 : -Infinity);
  }
  /** Distance, CSS pixels, between a canvas position and the projection of a point. */
  private pixelsFrom([x, y]: [number, number]): (p: Vec3) => number {
    const { ratio } = this.picture.frame();
    return (p) => {
      const [px, py] = this.pixelOf(p);
      return Math.hypot(px - x, py - y) / ratio;
    };
  }
  private listen(): void {
    const { session, picture } = this;
    const surface = picture.surface;
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    surface.addEventListener("pointerdown", (event) => {
      surface.setPointerCapture(event.pointerId);
      surface.focus({ preventScroll: true });
      this.pointers.set(event.pointerId, picture.at(event));
      if (this.pointers.size === 1) this.gesture = ++this.history.gesture;
      const tip = session.pose.value?.devices[0]?.tip;
      if (
        session.tool.value === "touch" &&
        this.pointer.isAvailable &&
        event.button === 0 &&
        !this.turnsObject &&
        tip &&
        this.pointers.size === 1
      ) {
        // shows the contact in the planes
        session.planes.value = { ...session.planes.peek(), follow: true, cross: null };
        this.touching.press(event, picture.at(event));
      } else if (session.tool.value === "plan" && event.button === 0 && this.pointers.size === 1) {
        const at = this.shownUnder(picture.at(event));
        this.isPlanning = at !== null;
        if (at) session.plans.press(at, this.pixelsFrom(picture.at(event)));
      } else if (this.pointers.size > 1) {
        if (this.isPlanning) session.plans.drop();
        this.isPlanning = false;
        this.touching.release();
      }
    });
    surface.addEventListener("pointermove", (event) => {
      const at = picture.at(event);
      const before = this.pointers.get(event.pointerId);
      if (!before) return;
      const { ratio } = picture.frame();
      const [dx, dy] = [(at[0] - before[0]) / ratio, (at[1] - before[1]) / ratio];
      if (this.pointers.size === 2) {
        const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
        this.moveCamera(() => {
          this.camera.zoom(spread(other, before, at));
          this.camera.pan(dx / 2, dy / 2);
        }, this.gesture);
      } else if (this.isPlanning) {
        const surfaceAt = this.shownUnder(at);
        if (surfaceAt) session.plans.move(surfaceAt);
      } else if (this.touching.isOn) this.touching.drag(event, (each) => picture.at(each));
      else if (event.buttons & 2) this.moveCamera(() => this.camera.zoom(Math.exp(-dy / 150)), this.gesture);
      else if (event.buttons & 4 || session.tool.value === "pan" || event.shiftKey)
        this.moveCamera(() => this.camera.pan(dx, dy), this.gesture);
      else if (this.turnsObject || event.altKey) this.turnObject(dx, dy);
      else this.moveCamera(() => this.camera.orbit(dx, dy), this.gesture);
      this.pointers.set(event.pointerId, at);
    });
    const up = (event: PointerEvent) => {
      this.pointers.delete(event.pointerId);
      this.touching.release();
      if (this.isPlanning) {
        this.isPlanning = false;
        const at = event.type === "pointerup" ? this.shownUnder(picture.at(event)) : null;
        if (at) session.plans.release(at, this.pixelsFrom(picture.at(event)));
      }
      // a target that was not sent yet is sent at the next interval
      if (this.rotation === this.rotationSent) this.rotation = null;
    };
    surface.addEventListener("pointerup", up);
    surface.addEventListener("pointercancel", up);
    surface.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        if (this.touching.isOn) this.touching.wheel(event.deltaY);
        // successive wheel events are one undo step
        else this.moveCamera(() => this.camera.zoom(Math.exp(-event.deltaY / 500)), this.history.gesture, "wheel");
      },
      { passive: false },
    );
    surface.addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey) return;
      const by: Record<string, [number, number]> = {
        ArrowLeft: [-12, 0],
        ArrowRight: [12, 0],
        ArrowUp: [0, -12],
        ArrowDown: [0, 12],
      };
      const direction = by[event.key];
      // the repeats of a key are one undo step
      if (!event.repeat) this.gesture = ++this.history.gesture;
      const move = (change: () => void) => this.moveCamera(change, this.gesture);
      if (direction && (event.altKey || this.turnsObject)) this.turnObject(...direction);
      else if (direction) move(() => this.camera.orbit(...direction));
      else if (event.key === "+" || event.key === "=") move(() => this.camera.zoom(1.2));
      else if (event.key === "-") move(() => this.camera.zoom(1 / 1.2));
      else if (event.key === "Home") move(() => this.reset());
      else return;
      event.preventDefault();
    });
  }
}
