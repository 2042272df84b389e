// Picture of one section, oblique or anatomical: the pose of its plane, progressive drawing, overlays, and the mouse,
// touch and keyboard input on it.

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
  spread,
  sub,
  type Anatomical,
  type Hanging,
  type Plane,
  type Vec3,
  type PlaneKind,
} from "../base/geometry.js";
import { quantity } from "../words/figures.js";
import type { History } from "../state/history.js";
import { drawMeasure, isWhole, type Measure } from "../drawing/measure.js";
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
  type Projection,
} from "../drawing/overlay.js";
import { drawNoGoOnPlane, drawNoGoWarning } from "../drawing/no_go_marks.js";
import { Picture } from "../drawing/picture.js";
import { drawPlanOnPlane } from "../drawing/plan_marks.js";
import { MAX_DISTANCE_MM, type PointerDevice } from "../state/pointer.js";
import { Touching } from "../touch/touching.js";
import type { Session } from "../state/session.js";
import { sliceAt, SliceChooser, slicesAlong } from "./slices.js";
import type { AnySlicer } from "./slicer.js";
import { drawStrainLegend } from "../drawing/strain.js";
import { Flag } from "../protocol/wire.js";
import { words } from "../words/words.js";

/** Undoable view of a section: `across_mm`, `pan` and `offset_mm` of SectionView. */
export interface SectionPlacement {
  across_mm: number;
  pan: [number, number];
  offset_mm: number;
}
/** Placement of a section's picture. */
interface View {
  mmPerPixel: number; // mm per CSS pixel
  pan: [number, number]; // displacement of the picture's centre to the right and down, mm
  offset_mm: number; // offset of the plane from the session's anchor, along its normal
}
/** Direction that the oblique plane contains: tool axis or force. "fixed": none, it is an anatomical plane. */
export type Along = "tool" | "force" | "fixed";
export const ALONG: Along[] = ["tool", "force", "fixed"];
/** Width of the slice slider at the right edge, which overlays leave free; CSS pixels. */
const SLIDER_PIXELS = 26;
/** Displacement of the tip per arrow key press; CSS pixels. */
const KEY_STEP_PIXELS = 2;
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
/** Drag distance of the window tool that doubles the window's width; CSS pixels. */
const WINDOW_PIXELS = 200;

/** Scale after zooming in by a factor, in mm per CSS pixel; clamped. */
const zoomed = (mmPerPixel: number, factor: number): number => Math.min(3, Math.max(0.005, mmPerPixel / factor));

export class SectionView {
  readonly picture: Picture;
  readonly along = signal<Along>("tool");
  /** Anatomical plane whose normal the oblique plane's normal is as close to as its direction allows. */
  readonly anatomical = signal<Anatomical>("sagittal");
  private readonly view = signal<View>({ mmPerPixel: 0.25, pan: [0, 0], offset_mm: 0 });
  normal: Vec3 = [1, 0, 0]; // unit normal of the plane, patient frame; smoothed for the oblique plane
  private hanging: Hanging | undefined; // display convention of the previous frame
  private plane: Plane = anatomicalPlane("axial", [0, 0, 0]);
  private byKeys = false; // the tip is held by a key
  private readonly touching: Touching;
  /** Position of the cursor, or target of the keys, while this picture moves the tip; the plane contains it. */
  private readonly steeredTip = signal<Vec3 | null>(null);
  private readonly mouse = signal<{ clientX: number; clientY: number } | null>(null); // mouse over this picture
  private drawn = ""; // key of all that the drawn pixels depend on, besides the appearance of the volume
  private drawnAppearance: Session["appearance"]["value"] | null = null;
  private drawn_ms = -Infinity; // time at which the current contents were first drawn
  private isAwaited = false; // the picture still shows the previous contents, because the shader is being compiled
  private sharpTo = Infinity; // number of rows, from the top, that are at full resolution; Infinity: all
  private fitted = NaN; // scale at which the volume was fitted into the picture, until the user changes it
  private size = 0; // shorter side of the picture, CSS pixels; 0: never shown
  private readonly pointers = new Map<number, [number, number]>(); // pressed pointers: canvas position by id
  private gesture = 0; // undo group of the current drag
  private readonly chooser = new SliceChooser(
    (slice) => this.moveTo(slice),
    () => (this.history.gesture += 1),
  );
  private plans = false; // the current press edits a trajectory of the plan
  /** Measure in progress; its last point follows the mouse. */
  private readonly measure = signal<Pick<Measure, "kind" | "points"> | null>(null);
  /** Anchor of the plane while a measure is in progress; null: the session's. */
  private readonly settlesAt = signal<Vec3 | null>(null);

  constructor(
    readonly kind: PlaneKind,
    private readonly session: Session,
    private readonly slicer: AnySlicer,
    private readonly measures: Measures,
    private readonly pointer: PointerDevice,
    private readonly history: History,
  ) {
    this.picture = new Picture(kind);
    history.register(
      kind,
      () => this.placement,
      (to) => (this.placement = to),
    );
    this.picture.element.append(this.chooser.element);
    this.touching = new Touching(
      session,
      pointer,
      // an outline next to the cursor
      (at, stroke) => stroke.outlineNear(this.patientAt(at), this.plane),
      (at) => this.patientAt(at),
      () =>
        this.steeredTip.peek() && this.touching.isTouchable(this.steeredTip.peek()!)
          ? words.insideThere
          : words.nothingThere,
    );
    this.listen();
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

  private show(change: Partial<View>): void {
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
  private change(by: string, act: () => void, gesture = this.history.gesture): void {
    this.history.change(`${by} ${this.kind}`, act, gesture);
  }
  /** Adapts the scale to a changed size of the picture, so that the extent stays the same. */
  private clampToVisible(): void {
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
      this.steeredTip.value ??
      add(this.settlesAt.value ?? this.session.anchor(), scale(this.normal, this.view.value.offset_mm))
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
    else if (pose && device && !this.steeredTip.value && !this.settlesAt.value && session.isFresh.value) {
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
  /** Point of the plane under the mouse, at the centre of the pixel, where the section is sampled; patient frame. */
  private readonly pointed = (): Vec3 | null => {
    const mouse = this.mouse.value;
    if (!mouse || !this.picture.isShown) return null;
    const [x, y] = this.picture.at(mouse);
    return this.patientAt([Math.floor(x) + 0.5, Math.floor(y) + 0.5]);
  };
  /** Canvas position of the projection of a point on the plane. */
  pixelOf(p: Vec3): [number, number] {
    const { width, height, ratio } = this.picture.frame();
    const d = sub(p, this.plane.centre);
    const mm = this.view.value.mmPerPixel / ratio;
    return [width / 2 + dot(d, this.plane.right) / mm, height / 2 + dot(d, this.plane.down) / mm];
  }
  /** Distance of a point from the plane. */
  farness_mm(p: Vec3): number {
    return Math.abs(dot(sub(p, this.plane.centre), normalOf(this.plane)));
  }
  get shownPlane(): Plane {
    return this.plane;
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
      this.clampToVisible();
    }
    if (this.measure.value && this.measure.value.kind !== session.tool.value) this.dropMeasure();
    this.plane = this.currentPlane();
    this.keepInView();
    const frame = picture.frame();
    const mm = this.view.value.mmPerPixel / frame.ratio;

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
      session.volumes.value.hash,
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

    frame.context.clearRect(0, 0, frame.width, frame.height);
    const projection: Projection = {
      pixel: (p) => this.pixelOf(p),
      direction: (v) => [dot(v, this.plane.right), dot(v, this.plane.down)],
      pixelsPerMm: () => 1 / mm,
      clearness: (p) => Math.max(0.15, 1 - this.farness_mm(p) / 12),
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
        if (session.scene.value.device.input === "pointer") drawForceBar(frame, session, device);
      }
    }
    for (const measure of [...this.measures.list.value, ...(this.measure.value ? [this.measure.value] : [])]) {
      drawMeasure(
        frame,
        measure,
        0.5 * session.volumes.value.voxelSize,
        (p) => this.pixelOf(p),
        (p) => this.farness_mm(p),
      );
    }
    const { kind, mm: thick_mm } = session.slab.value;
    if (kind !== "none") drawText(words.overSlab[kind](quantity(thick_mm, "mm")), "#eef3f5");
    if (this.settlesAt.value) drawText(words.settlesMeanwhile, "#8ee28a");
    drawLetters(
      frame,
      orientationLetters(this.plane.right, this.plane.down),
      session.scene.value.oriented,
      this.kind === "oblique",
      SLIDER_PIXELS,
    );
    drawScale(frame, mm);
    if (session.strain.value) drawStrainLegend(frame, session.isDeformed.value);
    drawSide(frame, session.scene.value, SLIDER_PIXELS);
    drawNoGoWarning(frame, session, top);
    drawAge(frame, session);
    const normal = normalOf(this.plane);
    const slices = slicesAlong(session.volumes.value, normal);
    this.chooser.show(sliceAt(slices, dot(this.plane.centre, normal)), slices.count);
  }

  /** Moves to a slice, from 1: the tip if it is held here, otherwise the planes, which then stop following it. */
  private moveTo(slice: number): void {
    const { session } = this;
    if (!session.volumes.value) return;
    const normal = normalOf(this.plane);
    const { first_mm, step_mm } = slicesAlong(session.volumes.value, normal);
    // relative to the target plane: the drawn one is updated in the next frame
    const by = scale(normal, first_mm + (slice - 1) * step_mm - dot(this.through(), normal));
    if (this.steeredTip.value) this.moveTipThrough(by);
    else if (this.settlesAt.value) this.settlesAt.value = add(this.settlesAt.value, by);
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
      this.pointers.size > 0 ||
      this.settlesAt.value
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
  private step(count: number, by = "keys"): void {
    if (!this.session.volumes.value) return;
    const normal = normalOf(this.plane);
    const shift = scale(normal, count * slicesAlong(this.session.volumes.value, normal).step_mm);
    if (this.steeredTip.value) this.moveTipThrough(shift);
    // the displayed normal may be opposite to the stored one
    else this.change(by, () => this.show({ offset_mm: this.view.peek().offset_mm + dot(shift, this.normal) }));
  }
  /** Zooms in by a factor about the picture's centre. */
  private zoom(factor: number, by = "keys"): void {
    this.change(by, () => this.show({ mmPerPixel: zoomed(this.view.peek().mmPerPixel, factor) }));
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
      if (this.pointers.size > 1) {
        this.dropPlan();
        return this.release();
      }
      if (event.button !== 0) return;
      if (session.tool.value === "touch" && this.pointer.isAvailable) {
        this.holdAt(this.patientAt(picture.at(event)));
        this.touching.press(event, picture.at(event));
      } else if (session.tool.value === "ruler" || session.tool.value === "angle") {
        this.addMeasurePoint(this.patientAt(picture.at(event)));
      } else if (session.tool.value === "plan") {
        this.plans = true;
        session.plans.press(this.patientAt(picture.at(event)), this.pixelsFrom(picture.at(event)));
      }
    });
    surface.addEventListener("pointermove", (event) => {
      const at = picture.at(event);
      this.mouse.value = { clientX: event.clientX, clientY: event.clientY };
      session.pointed.value = this.pointed;
      if (event.shiftKey && this.pointers.size === 0) {
        this.change("cross", () => session.showPosition(this.patientAt(at)));
      }
      const before = this.pointers.get(event.pointerId);
      if (before) this.change("drag", () => this.drag(event, before, at), this.gesture);
      else this.moveMeasurePoint(this.patientAt(at));
    });
    const up = (event: PointerEvent) => {
      this.pointers.delete(event.pointerId);
      this.release();
      if (this.plans) {
        this.plans = false;
        if (event.type === "pointerup")
          session.plans.release(this.patientAt(picture.at(event)), this.pixelsFrom(picture.at(event)));
      }
      const ruler = this.measure.value;
      if (
        ruler &&
        event.type === "pointerup" &&
        ruler.kind === "ruler" &&
        length(sub(ruler.points[1]!, ruler.points[0]!)) > 4 * this.view.value.mmPerPixel
      )
        this.finishMeasure();
    };
    surface.addEventListener("pointerup", up);
    surface.addEventListener("pointercancel", up);
    surface.addEventListener("pointerleave", () => {
      this.mouse.value = null;
    });
    surface.addEventListener(
      "dblclick",
      () => session.tool.value === "window" && this.change("reset", () => this.reset(), ++this.history.gesture),
    );
    surface.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        // successive wheel events share a gesture and are one undo step
        if (event.ctrlKey) this.zoom(Math.exp(-event.deltaY / 300), "zoom");
        else this.step(Math.sign(event.deltaY), "wheel");
      },
      { passive: false },
    );
    surface.addEventListener("keydown", (event) => {
      const actions: Record<string, () => void> = {
        ArrowUp: () => this.step(-1),
        ArrowDown: () => this.step(1),
        PageUp: () => this.step(-10),
        PageDown: () => this.step(10),
        "+": () => this.zoom(1.2),
        "=": () => this.zoom(1.2),
        "-": () => this.zoom(1 / 1.2),
        Home: () => this.change("reset", () => this.reset()),
        Escape: () => {
          this.dropMeasure();
          session.plans.drop();
        },
      };
      if (this.moveTipByKey(event)) return event.preventDefault();
      const action = actions[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      // a key press and its repeats are one undo step
      if (!event.repeat) this.history.gesture += 1;
      action();
    });
    const keyUp = () => this.byKeys && this.release();
    surface.addEventListener("keyup", keyUp);
    surface.addEventListener("blur", keyUp);
  }

  /** Makes a point the target of the tip. */
  private holdAt(p: Vec3): void {
    // an offset would take effect again at the release, and a plane that follows the tip would jump
    if (this.session.planes.value.follow) this.centre();
    this.steeredTip.value = p;
  }
  /** Moves the plane of a held tip by a displacement, and the tip with it, without force. */
  private moveTipThrough(by: Vec3): void {
    const steeredTip = this.nearContact(add(this.steeredTip.value!, by));
    this.steeredTip.value = steeredTip;
    this.pointer.move({ at: steeredTip, into: null });
  }
  /** Limits the distance of a target from a contact, which would follow a farther one with a jump. */
  private nearContact(to: Vec3): Vec3 {
    const device = this.session.pose.value?.devices[0];
    if (!device || !(device.flags & Flag.contact) || device.flags & Flag.inside) return to;
    const away = sub(to, device.proxy);
    return add(device.proxy, scale(away, Math.min(1, MAX_DISTANCE_MM / Math.max(length(away), 1e-9))));
  }
  /** Abandons the edit of a trajectory by the current press. */
  private dropPlan(): void {
    if (!this.plans) return;
    this.plans = false;
    this.session.plans.drop();
  }
  /** Releases the tip if it is held here. */
  private release(): void {
    if (!this.steeredTip.value) return;
    this.steeredTip.value = null;
    this.byKeys = false;
    this.touching.release();
    this.pointer.release();
  }

  /**
   * Moves the tip by an arrow or page key if this viewer has the pointer or may take it; with Shift, along the outline,
   * with the chosen force. The tip is held until the key is released.
   * @returns whether the key has moved the tip
   */
  private moveTipByKey({ key, shiftKey }: KeyboardEvent): boolean {
    const { right, down } = this.plane;
    const directions: Record<string, Vec3> = {
      ArrowLeft: scale(right, -1),
      ArrowRight: right,
      ArrowUp: scale(down, -1),
      ArrowDown: down,
      PageUp: scale(normalOf(this.plane), -1),
      PageDown: normalOf(this.plane),
    };
    const direction = directions[key];
    const tip = this.pointer.position?.at ?? this.session.pose.value?.devices[0]?.tip;
    const isTouching = this.session.tool.value === "touch" && this.pointer.isAvailable;
    if (!direction || !tip || !isTouching || this.pointers.size > 0) return false;
    if (this.byKeys && this.touching.isOn !== shiftKey) this.release();
    const from = this.steeredTip.value ?? tip;
    const step_mm = KEY_STEP_PIXELS * this.view.value.mmPerPixel;
    if (shiftKey) this.strokeTo(add(from, scale(this.touching.stroke?.along(direction) ?? direction, step_mm)));
    else this.moveFreelyTo(this.nearContact(add(from, scale(direction, step_mm))));
    this.byKeys = true;
    return true;
  }
  private moveFreelyTo(to: Vec3): void {
    if (!this.byKeys) this.pointer.hold([], false);
    this.holdAt(to);
    this.pointer.move({ at: to, into: null });
  }
  /** Strokes to the outline next to a position, from which the next step goes on; the plane contains it at once. */
  private strokeTo(to: Vec3): void {
    this.holdAt(to);
    this.plane = this.currentPlane();
    this.touching.step(this.pixelOf(to));
    this.steeredTip.value = this.touching.stroke?.point?.at ?? to;
  }

  /** Handles the movement of a pressed pointer, from canvas position `before` to `at`. */
  private drag(event: PointerEvent, before: [number, number], at: [number, number]): void {
    const { session } = this;
    const { ratio } = this.picture.frame();
    const { mmPerPixel, pan } = this.view.value;
    const panned = (by: number, scale_mm: number): [number, number] => [
      pan[0] - by * dx * scale_mm,
      pan[1] - by * dy * scale_mm,
    ];
    const [dx, dy] = [(at[0] - before[0]) / ratio, (at[1] - before[1]) / ratio];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
      const zoomed_mm = zoomed(mmPerPixel, spread(other, before, at));
      this.show({ mmPerPixel: zoomed_mm, pan: panned(0.5, zoomed_mm) });
    } else if (this.plans) {
      session.plans.move(this.patientAt(at));
    } else if (this.touching.isOn) {
      this.steeredTip.value = this.patientAt(at);
      this.touching.drag(event, (each) => this.picture.at(each));
    } else if (event.buttons & 2) {
      this.show({ mmPerPixel: zoomed(mmPerPixel, Math.exp(-dy / 150)) });
    } else if (event.buttons & 4 || session.tool.value === "pan") {
      this.show({ pan: panned(1, mmPerPixel) });
    } else if (session.tool.value === "window") {
      const width = session.window.value.width;
      session.window.value = {
        level: session.window.value.level - (dy * width) / WINDOW_PIXELS,
        width: Math.max(session.minWindowWidth, width * Math.exp(dx / WINDOW_PIXELS)),
      };
    } else this.moveMeasurePoint(this.patientAt(at));
    this.pointers.set(event.pointerId, at);
  }

  /** Function that gives the distance, in CSS pixels, of a point's projection from a canvas position. */
  private pixelsFrom([x, y]: [number, number]): (p: Vec3) => number {
    const { ratio } = this.picture.frame();
    return (p) => {
      const [px, py] = this.pixelOf(p);
      return Math.hypot(px - x, py - y) / ratio;
    };
  }
  /** Moves the point of the measurement in progress that was set last. */
  private moveMeasurePoint(p: Vec3): void {
    const measure = this.measure.value;
    if (measure) this.measure.value = { ...measure, points: [...measure.points.slice(0, -1), p] };
  }
  private addMeasurePoint(p: Vec3): void {
    if (!this.measure.value) {
      // hold the plane in place, so that it contains every point of the measure
      this.settlesAt.value = sub(this.plane.centre, scale(this.normal, this.view.value.offset_mm));
      this.measure.value = { kind: this.session.tool.value as "ruler" | "angle", points: [p, p] };
      return;
    }
    // sets the point that follows the mouse: a touch is not preceded by a hover
    this.moveMeasurePoint(p);
    const measure = this.measure.value;
    if (isWhole(measure)) this.finishMeasure();
    else this.measure.value = { ...measure, points: [...measure.points, p] };
  }
  private finishMeasure(): void {
    const normal = normalOf(this.plane);
    const measure = this.measure.value!;
    this.measures.add({
      ...measure,
      plane: this.kind,
      normal,
      slice: sliceAt(slicesAlong(this.session.volumes.value!, normal), dot(measure.points[0]!, normal)),
    });
    this.dropMeasure();
  }
  private dropMeasure(): void {
    this.measure.value = null;
    this.settlesAt.value = null;
  }
}
