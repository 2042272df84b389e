// Picture of one section, oblique or anatomical: the pose of its plane, progressive drawing and overlays.

import { signal } from "@preact/signals-core";
import {
  add,
  anatomicalPlane,
  dot,
  fitFactor,
  hang,
  length,
  normalOf,
  normalContaining,
  normalize,
  orientationLetters,
  rotate,
  scale,
  sub,
  type Anatomical,
  type Hanging,
  type Plane,
  type Vec3,
  type PlaneKind,
} from "../base/geometry.js";
import { quantity } from "../words/figures.js";
import type { History } from "../state/history.js";
import { drawMeasure } from "../drawing/measure.js";
import type { Measures } from "./measures_panel.js";
import {
  drawAge,
  drawCross,
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
import { drawNoGoOnPlane, drawNoGoWarning } from "../drawing/no_go_marks.js";
import { Picture } from "../drawing/picture.js";
import { drawPlanOnPlane } from "../drawing/plan_marks.js";
import type { PointerDevice } from "../state/pointer.js";
import type { Session } from "../state/session.js";
import { type MovableSection, SectionInput, type View, zoomed } from "./section_input.js";
import { sliceAt, SliceChooser, slicesAlong } from "./slices.js";
import type { AnySlicer } from "./slicer.js";
import { drawStrainLegend } from "../drawing/strain.js";
import { words } from "../words/words.js";

/** Undoable view of a section: `across_mm`, `pan` and `offset_mm` of SectionView. */
export interface SectionPlacement {
  across_mm: number;
  pan: [number, number];
  offset_mm: number;
}
/** Direction that the oblique plane contains: tool axis or force. "fixed": none, it is an anatomical plane. */
export type Along = "tool" | "force" | "fixed";
export const ALONG: Along[] = ["tool", "force", "fixed"];
/** Width of the slice slider at the right edge, which overlays leave free; CSS pixels. */
const SLIDER_PIXELS = 26;
/** Unit normals of the anatomical planes; patient frame (LPS). */
const NORMALS: Record<Anatomical, Vec3> = { axial: [0, 0, 1], sagittal: [1, 0, 0], coronal: [0, 1, 0] };
const SMOOTHING = 0.2; // fraction of the difference to the target normal that one frame removes
/** Angle to the target normal, rad, below which the plane snaps to it: under a pixel at the edge of any picture. */
const MIN_STEP = 1e-5;
/**
 * Progressive refinement. A picture that would exceed the time allowed per frame is drawn at a resolution reduced by a
 * factor of at most COARSEST per axis. After STILL_AFTER_MS without changes it is redrawn at full resolution, one band
 * of at least MIN_ROWS rows per frame.
 */
const STILL_AFTER_MS = 250;
const COARSEST = 4;
const MIN_ROWS = 4;
export class SectionView implements MovableSection {
  readonly picture: Picture;
  readonly along = signal<Along>("tool");
  /** Anatomical plane whose normal the oblique plane's normal is as close to as its direction allows. */
  readonly anatomical = signal<Anatomical>("sagittal");
  readonly view = signal<View>({ mmPerPixel: 0.25, pan: [0, 0], offset_mm: 0 });
  normal: Vec3 = [1, 0, 0]; // unit normal of the plane, patient frame; smoothed for the oblique plane
  private hanging: Hanging | undefined; // display convention of the previous frame
  private plane: Plane = anatomicalPlane("axial", [0, 0, 0]);
  private drawn = ""; // key of all that the drawn pixels depend on, besides the appearance of the volume
  private drawnAppearance: Session["appearance"]["value"] | null = null;
  private drawn_ms = -Infinity; // time at which the current contents were first drawn
  private isAwaited = false; // the picture still shows the previous contents, because the shader is being compiled
  private sharpTo = Infinity; // number of rows, from the top, that are at full resolution; Infinity: all
  private fitted = NaN; // scale at which the volume was fitted into the picture, until the user changes it
  private size = 0; // shorter side of the picture, CSS pixels; 0: never shown
  private readonly chooser = new SliceChooser(
    (slice) => this.moveTo(slice),
    () => (this.history.gesture += 1),
  );
  private readonly input: SectionInput;

  constructor(
    readonly kind: PlaneKind,
    private readonly session: Session,
    private readonly slicer: AnySlicer,
    private readonly measures: Measures,
    pointer: PointerDevice,
    private readonly history: History,
  ) {
    this.picture = new Picture(kind);
    history.register(
      kind,
      () => this.placement,
      (to) => (this.placement = to),
    );
    this.picture.element.append(this.chooser.element);
    this.input = new SectionInput(this, session, measures, pointer, history);
  }

  /** Shows the whole volume, without pan and offset. */
  reset(): void {
    const volumes = this.session.volumes.value;
    const { clientWidth, clientHeight } = this.picture.surface;
    if (volumes && clientWidth > 0) {
      this.size = Math.min(clientWidth, clientHeight);
      const { right, down } = this.currentPlane();
      const corners = volumes.corners.map((corner) => sub(corner, volumes.centre));
      const across = corners.map((corner): [number, number] => [dot(corner, right), dot(corner, down)]);
      this.fitted = fitFactor(across, clientWidth, clientHeight);
      this.show({ mmPerPixel: this.fitted });
    }
    this.show({ pan: [0, 0], offset_mm: 0 });
  }

  show(change: Partial<View>): void {
    this.view.value = { ...this.view.peek(), ...change };
  }
  /** Undoes the offset from the session's anchor. */
  centre(): void {
    this.show({ offset_mm: 0 });
  }
  /** Extent across the shorter side of the picture, mm. 0: the picture was never shown. */
  get across_mm(): number {
    return this.view.value.mmPerPixel * this.size;
  }
  set across_mm(mm: number) {
    const { clientWidth, clientHeight } = this.picture.surface;
    // a hidden picture has size 0: keep the previous one
    this.size = Math.min(clientWidth, clientHeight) || this.size;
    if (this.size > 0 && mm > 0) this.show({ mmPerPixel: mm / this.size });
  }
  get placement(): SectionPlacement {
    const { pan, offset_mm } = this.view.value;
    return { across_mm: this.across_mm, pan, offset_mm };
  }
  set placement({ across_mm, pan, offset_mm }: SectionPlacement) {
    this.across_mm = across_mm;
    this.show({ pan, offset_mm });
  }
  /**
   * Changes the view as an undo step.
   * @param by       name of the change
   * @param gesture  changes with equal `by` and gesture are one undo step
   */
  change(by: string, act: () => void, gesture = this.history.gesture): void {
    this.history.change(`${by} ${this.kind}`, act, gesture);
  }
  /** Adapts the scale to a changed size of the picture, so that the extent stays the same. */
  private preserveExtent(): void {
    const { clientWidth, clientHeight } = this.picture.surface;
    const size = Math.min(clientWidth, clientHeight);
    const { mmPerPixel, pan, offset_mm } = this.view.peek();
    if (this.size === 0 || mmPerPixel === this.fitted) {
      this.reset();
      this.show({ pan, offset_mm });
    } else this.show({ mmPerPixel: (mmPerPixel * this.size) / size });
    this.size = size;
  }

  /** Point that the target plane contains; patient frame. */
  private through(): Vec3 {
    return (
      this.input.steeredTip.value ??
      add(this.input.measureAnchor.value ?? this.session.anchor(), scale(this.normal, this.view.value.offset_mm))
    );
  }
  /**
   * Plane to draw in this frame; patient frame. An oblique normal approaches its target by exponential smoothing. It
   * does not change while the tip is moved here, during a measure, for stale poses, and without a sufficient force if
   * the plane follows that.
   */
  private currentPlane(): Plane {
    const { session, kind } = this;
    const through = this.through();
    if (kind !== "oblique") {
      this.normal = NORMALS[kind];
      return this.centred(anatomicalPlane(kind, through));
    }
    const pose = session.pose.value;
    const device = pose?.devices[0];
    const { follow, obliqueNormal } = session.planes.value;
    if (obliqueNormal && !follow) this.normal = obliqueNormal;
    else if (
      pose &&
      device &&
      !this.input.steeredTip.value &&
      !this.input.measureAnchor.value &&
      session.isFresh.value
    ) {
      const wanted = NORMALS[this.anatomical.value];
      const fallback = NORMALS[this.anatomical.value === "sagittal" ? "coronal" : "sagittal"];
      let normal: Vec3 | null = null;
      if (this.along.value === "fixed") normal = wanted;
      else if (this.along.value === "tool")
        normal = normalContaining(session.toPatient(pose, rotate(device.orientation, [0, 0, 1])), wanted, fallback);
      else if (length(device.force) > 0.03)
        normal = normalContaining(session.toPatient(pose, device.force), wanted, fallback);
      if (normal) {
        // a plane has two unit normals: take the nearer one
        const same = dot(normal, this.normal) < 0 ? scale(normal, -1) : normal;
        // snap at the end: exponential smoothing never arrives, so every frame would be a redraw
        const isThere = length(sub(same, this.normal)) < MIN_STEP;
        this.normal = isThere ? same : normalize(add(scale(this.normal, 1 - SMOOTHING), scale(same, SMOOTHING)));
      }
    }
    const { plane, hanging } = hang(this.normal, through, this.hanging);
    this.hanging = hanging;
    return this.centred(plane);
  }
  /** The same plane, centred on the projection of the volume's centre and displaced by the pan. */
  private centred(plane: Plane): Plane {
    const middle = this.session.volumes.value?.centre ?? plane.centre;
    const n = normalOf(plane);
    const onPlane = sub(middle, scale(n, dot(sub(middle, plane.centre), n)));
    const { pan } = this.view.value;
    return { ...plane, centre: add(onPlane, add(scale(plane.right, pan[0]), scale(plane.down, pan[1]))) };
  }

  /** Point of the plane at a canvas position; patient frame. */
  patientAt([x, y]: [number, number]): Vec3 {
    const { width, height, ratio } = this.picture.frame();
    const mm = this.view.value.mmPerPixel / ratio;
    return add(
      this.plane.centre,
      add(scale(this.plane.right, (x - width / 2) * mm), scale(this.plane.down, (y - height / 2) * mm)),
    );
  }
  /** Canvas position of the projection of a point on the plane. */
  pixelOf(p: Vec3): [number, number] {
    const { width, height, ratio } = this.picture.frame();
    const d = sub(p, this.plane.centre);
    const mm = this.view.value.mmPerPixel / ratio;
    return [width / 2 + dot(d, this.plane.right) / mm, height / 2 + dot(d, this.plane.down) / mm];
  }
  /** Distance of a point from the plane. */
  distance_mm(p: Vec3): number {
    return Math.abs(dot(sub(p, this.plane.centre), normalOf(this.plane)));
  }
  get shownPlane(): Plane {
    return this.plane;
  }
  /** Updates the plane before the next frame. */
  updatePlane(): void {
    this.plane = this.currentPlane();
  }

  /** Whether the current contents are not yet drawn at full resolution everywhere. */
  get isCoarse(): boolean {
    return this.picture.isShown && (this.isAwaited || this.sharpTo < this.picture.base.canvas.height);
  }
  /**
   * Draws the section, if it has changed or can be refined, and its overlays.
   * @param now     current time, ms
   * @param max_ms  time that the section may take; Infinity: drawn at full resolution, whatever it takes
   */
  draw(now: number, max_ms: number): void {
    const { session, picture } = this;
    const resized = picture.fit();
    if (!picture.isShown || !session.volumes.value || !session.scene.value) return;
    if (resized) {
      // another size clears a canvas, even if it is that of the previous picture
      this.drawn = "";
      this.preserveExtent();
    }
    if (this.input.measure.value && this.input.measure.value.kind !== session.tool.value) this.input.dropMeasure();
    this.plane = this.currentPlane();
    this.keepInView();
    const frame = picture.frame();
    const mm = this.view.value.mmPerPixel / frame.ratio;

    this.refine(now, max_ms, frame, mm);
    this.drawOverlays(frame, mm);
    const normal = normalOf(this.plane);
    const slices = slicesAlong(session.volumes.value, normal);
    this.chooser.show(sliceAt(slices, dot(this.plane.centre, normal)), slices.count);
  }
  /**
   * Draws the section's pixels, if they have changed or can be refined: at first coarsely if time is short, then band
   * by band at full resolution.
   * @param max_ms  as for draw()
   * @param mm      per pixel of the frame
   */
  private refine(now: number, max_ms: number, frame: Frame, mm: number): void {
    const { session, picture } = this;
    const { value: volumes } = session.volumes;
    if (!volumes) return;
    // everything that determines the section's pixels, except the appearance of the volume
    const key = JSON.stringify([
      this.plane,
      mm,
      session.window.value,
      session.fill.value,
      session.outlines.value,
      session.strain.value,
      session.slab.value,
      frame.width,
      frame.height,
      volumes.hash,
    ]);
    const style = {
      window: session.storedWindow(),
      fill: session.fill.value,
      outlines: session.outlines.value,
      strain: session.strain.value,
      slab: session.slab.value,
    };
    const appearance = session.appearance.value;
    const isOther = key !== this.drawn || appearance !== this.drawnAppearance;
    // estimated drawing time at full resolution, relative to the time allowed
    const most = this.slicer.cost_msOf(this.plane, session.slab.value, frame.width * frame.height) / max_ms;
    // another kind of section needs another shader, which compiles in the background
    this.isAwaited =
      isOther && max_ms < Infinity && !this.slicer.isCompiled(session.slab.value.kind !== "none", session.strain.value);
    if (this.isAwaited) {
      // keep the previous contents
    } else if (isOther || (this.isCoarse && most < 1)) {
      const reduction = Math.min(COARSEST, Math.sqrt(Math.max(1, most)));
      this.slicer.draw(picture.base, this.plane, mm, style, { reduction, from: 0, to: Infinity });
      this.sharpTo = reduction > 1 ? 0 : Infinity;
      this.drawn = key;
      this.drawnAppearance = appearance;
      this.drawn_ms = now;
    } else if (this.isCoarse && now - this.drawn_ms > STILL_AFTER_MS) {
      const to = this.sharpTo + Math.max(MIN_ROWS, Math.floor(frame.height / most));
      this.slicer.draw(picture.base, this.plane, mm, style, { reduction: 1, from: this.sharpTo, to });
      this.sharpTo = to;
    }
  }
  /** @param mm  per pixel of the frame */
  private drawOverlays(frame: Frame, mm: number): void {
    const { session } = this;
    const { value: volumes } = session.volumes;
    const { value: scene } = session.scene;
    if (!volumes || !scene) return;
    frame.context.clearRect(0, 0, frame.width, frame.height);
    const projection: Projection = {
      pixel: (p) => this.pixelOf(p),
      direction: (v) => [dot(v, this.plane.right), dot(v, this.plane.down)],
      pixelsPerMm: () => 1 / mm,
      clearness: (p) => Math.max(0.15, 1 - this.distance_mm(p) / 12),
    };
    drawNoGoOnPlane(frame, session, { plane: this.plane, pixel: (p) => this.pixelOf(p), mmPerPixel: mm });
    drawPlanOnPlane(frame, session.plans, this.plane, (p) => this.pixelOf(p));
    const { cross, follow } = session.planes.value;
    if (cross && !follow) drawCross(frame, this.pixelOf(cross));
    const device = session.pose.value?.devices[0];
    let top = 40;
    const drawText = (line: string, colour: string) => {
      text(frame, line, 12 * frame.ratio, top * frame.ratio, 12, colour, "left", "top");
      top += 18;
    };
    if (device) {
      drawTrail(frame, session, projection);
      for (const each of session.drawn) drawTool(frame, session, each, projection);
      if (this.kind === "oblique") {
        drawText(touchedText(session, device), session.isFresh.value ? "#eef3f5" : "#a4adb3");
        if (scene.device.input === "pointer") drawForceBar(frame, session, device);
      }
    }
    for (const measure of [
      ...this.measures.list.value,
      ...(this.input.measure.value ? [this.input.measure.value] : []),
    ]) {
      drawMeasure(
        frame,
        measure,
        0.5 * volumes.voxelSize,
        (p) => this.pixelOf(p),
        (p) => this.distance_mm(p),
      );
    }
    const { kind, mm: thick_mm } = session.slab.value;
    if (kind !== "none") drawText(words.overSlab[kind](quantity(thick_mm, "mm")), "#eef3f5");
    if (this.input.measureAnchor.value) drawText(words.heldWhileMeasuring, "#8ee28a");
    drawLetters(
      frame,
      orientationLetters(this.plane.right, this.plane.down),
      scene.oriented,
      this.kind === "oblique",
      SLIDER_PIXELS,
    );
    drawScale(frame, mm);
    if (session.strain.value) drawStrainLegend(frame, session.isDeformed.value);
    drawSide(frame, scene, SLIDER_PIXELS);
    drawNoGoWarning(frame, session, top);
    drawAge(frame, session);
  }

  /** Moves to a slice, from 1: the tip if it is held here, otherwise the planes, which then stop following it. */
  private moveTo(slice: number): void {
    const { session } = this;
    if (!session.volumes.value) return;
    const normal = normalOf(this.plane);
    const { first_mm, step_mm } = slicesAlong(session.volumes.value, normal);
    // relative to the target plane: the drawn one is updated in the next frame
    const by = scale(normal, first_mm + (slice - 1) * step_mm - dot(this.through(), normal));
    if (this.input.steeredTip.value) this.input.moveTipThrough(by);
    else if (this.input.measureAnchor.value) this.input.measureAnchor.value = add(this.input.measureAnchor.value, by);
    else this.change("slice", () => session.showPosition(add(session.anchor(), by)));
  }

  /** Pans the picture so that a followed tip stays out of the outer 8 % on each side. */
  private keepInView(): void {
    const tip = this.session.pose.value?.devices[0]?.tip;
    // the picture must not move under a press or a measure in progress
    if (
      !tip ||
      !this.session.planes.value.follow ||
      this.session.isPressing.value ||
      this.input.isPressed ||
      this.input.measureAnchor.value
    )
      return;
    const { width, height, ratio } = this.picture.frame();
    const [x, y] = this.pixelOf(tip);
    const over = (at: number, most: number) =>
      at < 0.08 * most ? at - 0.08 * most : at > 0.92 * most ? at - 0.92 * most : 0;
    const [dx, dy] = [over(x, width), over(y, height)];
    if (dx === 0 && dy === 0) return;
    const { pan, mmPerPixel } = this.view.value;
    this.show({ pan: [pan[0] + (dx * mmPerPixel) / ratio, pan[1] + (dy * mmPerPixel) / ratio] });
    this.plane = this.centred(this.plane);
  }

  /** Moves along the normal by a number of slices: the tip if it is held here, otherwise the plane. */
  step(count: number, by = "keys"): void {
    if (!this.session.volumes.value) return;
    const normal = normalOf(this.plane);
    const shift = scale(normal, count * slicesAlong(this.session.volumes.value, normal).step_mm);
    if (this.input.steeredTip.value) this.input.moveTipThrough(shift);
    // the displayed normal may be opposite to the stored one
    else this.change(by, () => this.show({ offset_mm: this.view.peek().offset_mm + dot(shift, this.normal) }));
  }
  /** Zooms in by a factor about the picture's centre. */
  zoom(factor: number, by = "keys"): void {
    this.change(by, () => this.show({ mmPerPixel: zoomed(this.view.peek().mmPerPixel, factor) }));
  }
}
