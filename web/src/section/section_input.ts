// Mouse, touch and keyboard input on the picture of a section: moving the tip, measures, plans, pan, zoom and window.

import { type Signal, signal } from "@preact/signals-core";
import {
  add,
  dot,
  length,
  normalOf,
  type Plane,
  type PlaneKind,
  scale,
  spread,
  sub,
  type Vec3,
} from "../base/geometry.js";
import { isWhole, type Measure } from "../drawing/measure.js";
import type { Picture } from "../drawing/picture.js";
import { Flag } from "../protocol/wire.js";
import type { History } from "../state/history.js";
import { MAX_DISTANCE_MM, type PointerDevice } from "../state/pointer.js";
import type { Session } from "../state/session.js";
import { Touching } from "../touch/touching.js";
import { words } from "../words/words.js";
import type { Measures } from "./measures_panel.js";
import { sliceAt, slicesAlong } from "./slices.js";

/** Displacement of the tip per arrow key press; CSS pixels. */
const KEY_STEP_PIXELS = 2;
/** Drag distance of the window tool that doubles the window's width; CSS pixels. */
const WINDOW_PIXELS = 200;

/** Scale after zooming in by a factor, in mm per CSS pixel; clamped. */
export const zoomed = (mmPerPixel: number, factor: number): number => Math.min(3, Math.max(0.005, mmPerPixel / factor));

/** Placement of a section's picture. */
export interface View {
  mmPerPixel: number; // mm per CSS pixel
  pan: [number, number]; // displacement of the picture's centre to the right and down, mm
  offset_mm: number; // offset of the plane from the session's anchor, along its normal
}

/** Section that the input moves: SectionView. */
export interface MovableSection {
  readonly kind: PlaneKind;
  readonly picture: Picture;
  readonly view: Signal<View>;
  readonly normal: Vec3;
  readonly shownPlane: Plane;
  patientAt(pixel: [number, number]): Vec3;
  pixelOf(p: Vec3): [number, number];
  show(change: Partial<View>): void;
  reset(): void;
  centre(): void;
  change(by: string, act: () => void, gesture?: number): void;
  updatePlane(): void;
  step(count: number, by?: string): void;
  zoom(factor: number, by?: string): void;
}

export class SectionInput {
  private byKeys = false; // the tip is held by a key
  private readonly touching: Touching;
  /** Position of the cursor, or target of the keys, while this picture moves the tip; the plane contains it. */
  readonly steeredTip = signal<Vec3 | null>(null);
  private readonly mouse = signal<{ clientX: number; clientY: number } | null>(null); // mouse over this picture
  private readonly pointers = new Map<number, [number, number]>(); // pressed pointers: canvas position by id
  private gesture = 0; // undo group of the current drag
  private isPlanning = false; // the current press edits a trajectory of the plan
  /** Measure in progress; its last point follows the mouse. */
  readonly measure = signal<Pick<Measure, "kind" | "points"> | null>(null);
  /** Anchor of the plane while a measure is in progress; null: the session's. */
  readonly measureAnchor = signal<Vec3 | null>(null);

  constructor(
    private readonly section: MovableSection,
    private readonly session: Session,
    private readonly measures: Measures,
    private readonly pointer: PointerDevice,
    private readonly history: History,
  ) {
    this.touching = new Touching(
      session,
      pointer,
      // an outline next to the cursor
      (at, stroke) => stroke.outlineNear(this.section.patientAt(at), this.section.shownPlane),
      (at) => this.section.patientAt(at),
      () =>
        this.steeredTip.peek() && this.touching.isTouchable(this.steeredTip.peek()!)
          ? words.insideThere
          : words.nothingThere,
    );
    this.listen();
  }

  /** Whether a pointer is pressed on the picture. */
  get isPressed(): boolean {
    return this.pointers.size > 0;
  }

  /** Point of the plane under the mouse, at the centre of the pixel, where the section is sampled; patient frame. */
  private readonly pointed = (): Vec3 | null => {
    const mouse = this.mouse.value;
    if (!mouse || !this.section.picture.isShown) return null;
    const [x, y] = this.section.picture.at(mouse);
    return this.section.patientAt([Math.floor(x) + 0.5, Math.floor(y) + 0.5]);
  };
  private listen(): void {
    const { session } = this;
    const { picture } = this.section;
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
        this.holdAt(this.section.patientAt(picture.at(event)));
        this.touching.press(event, picture.at(event));
      } else if (session.tool.value === "ruler" || session.tool.value === "angle") {
        this.addMeasurePoint(this.section.patientAt(picture.at(event)));
      } else if (session.tool.value === "plan") {
        this.isPlanning = true;
        session.plans.press(this.section.patientAt(picture.at(event)), this.pixelsFrom(picture.at(event)));
      }
    });
    surface.addEventListener("pointermove", (event) => {
      const at = picture.at(event);
      this.mouse.value = { clientX: event.clientX, clientY: event.clientY };
      session.pointed.value = this.pointed;
      if (event.shiftKey && this.pointers.size === 0) {
        this.section.change("cross", () => session.showPosition(this.section.patientAt(at)));
      }
      const before = this.pointers.get(event.pointerId);
      if (before) this.section.change("drag", () => this.drag(event, before, at), this.gesture);
      else this.moveMeasurePoint(this.section.patientAt(at));
    });
    const up = (event: PointerEvent) => {
      this.pointers.delete(event.pointerId);
      this.release();
      if (this.isPlanning) {
        this.isPlanning = false;
        if (event.type === "pointerup")
          session.plans.release(this.section.patientAt(picture.at(event)), this.pixelsFrom(picture.at(event)));
      }
      const ruler = this.measure.value;
      if (
        ruler &&
        event.type === "pointerup" &&
        ruler.kind === "ruler" &&
        length(sub(ruler.points[1]!, ruler.points[0]!)) > 4 * this.section.view.value.mmPerPixel
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
      () =>
        session.tool.value === "window" &&
        this.section.change("reset", () => this.section.reset(), ++this.history.gesture),
    );
    surface.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        // successive wheel events share a gesture and are one undo step
        if (event.ctrlKey) this.section.zoom(Math.exp(-event.deltaY / 300), "zoom");
        else this.section.step(Math.sign(event.deltaY), "wheel");
      },
      { passive: false },
    );
    surface.addEventListener("keydown", (event) => {
      const actions: Record<string, () => void> = {
        ArrowUp: () => this.section.step(-1),
        ArrowDown: () => this.section.step(1),
        PageUp: () => this.section.step(-10),
        PageDown: () => this.section.step(10),
        "+": () => this.section.zoom(1.2),
        "=": () => this.section.zoom(1.2),
        "-": () => this.section.zoom(1 / 1.2),
        Home: () => this.section.change("reset", () => this.section.reset()),
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
    if (this.session.planes.value.follow) this.section.centre();
    this.steeredTip.value = p;
  }
  /** Moves the plane of a held tip by a displacement, and the tip with it, without force. */
  moveTipThrough(by: Vec3): void {
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
    if (!this.isPlanning) return;
    this.isPlanning = false;
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
    const { right, down } = this.section.shownPlane;
    const directions: Record<string, Vec3> = {
      ArrowLeft: scale(right, -1),
      ArrowRight: right,
      ArrowUp: scale(down, -1),
      ArrowDown: down,
      PageUp: scale(normalOf(this.section.shownPlane), -1),
      PageDown: normalOf(this.section.shownPlane),
    };
    const direction = directions[key];
    const tip = this.pointer.position?.at ?? this.session.pose.value?.devices[0]?.tip;
    const isTouching = this.session.tool.value === "touch" && this.pointer.isAvailable;
    if (!direction || !tip || !isTouching || this.pointers.size > 0) return false;
    if (this.byKeys && this.touching.isOn !== shiftKey) this.release();
    const from = this.steeredTip.value ?? tip;
    const step_mm = KEY_STEP_PIXELS * this.section.view.value.mmPerPixel;
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
    this.section.updatePlane();
    this.touching.step(this.section.pixelOf(to));
    this.steeredTip.value = this.touching.stroke?.point?.at ?? to;
  }

  /** Handles the movement of a pressed pointer, from canvas position `before` to `at`. */
  private drag(event: PointerEvent, before: [number, number], at: [number, number]): void {
    const { session } = this;
    const { ratio } = this.section.picture.frame();
    const { mmPerPixel, pan } = this.section.view.value;
    const panned = (by: number, scale_mm: number): [number, number] => [
      pan[0] - by * dx * scale_mm,
      pan[1] - by * dy * scale_mm,
    ];
    const [dx, dy] = [(at[0] - before[0]) / ratio, (at[1] - before[1]) / ratio];
    if (this.pointers.size === 2) {
      const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
      const zoomed_mm = zoomed(mmPerPixel, spread(other, before, at));
      this.section.show({ mmPerPixel: zoomed_mm, pan: panned(0.5, zoomed_mm) });
    } else if (this.isPlanning) {
      session.plans.move(this.section.patientAt(at));
    } else if (this.touching.isOn) {
      this.steeredTip.value = this.section.patientAt(at);
      this.touching.drag(event, (each) => this.section.picture.at(each));
    } else if (event.buttons & 2) {
      this.section.show({ mmPerPixel: zoomed(mmPerPixel, Math.exp(-dy / 150)) });
    } else if (event.buttons & 4 || session.tool.value === "pan") {
      this.section.show({ pan: panned(1, mmPerPixel) });
    } else if (session.tool.value === "window") {
      const width = session.window.value.width;
      session.window.value = {
        level: session.window.value.level - (dy * width) / WINDOW_PIXELS,
        width: Math.max(session.minWindowWidth, width * Math.exp(dx / WINDOW_PIXELS)),
      };
    } else this.moveMeasurePoint(this.section.patientAt(at));
    this.pointers.set(event.pointerId, at);
  }

  /** Function that gives the distance, in CSS pixels, of a point's projection from a canvas position. */
  private pixelsFrom([x, y]: [number, number]): (p: Vec3) => number {
    const { ratio } = this.section.picture.frame();
    return (p) => {
      const [px, py] = this.section.pixelOf(p);
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
      this.measureAnchor.value = sub(
        this.section.shownPlane.centre,
        scale(this.section.normal, this.section.view.value.offset_mm),
      );
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
    const normal = normalOf(this.section.shownPlane);
    const measure = this.measure.value!;
    this.measures.add({
      ...measure,
      plane: this.section.kind,
      normal,
      slice: sliceAt(slicesAlong(this.session.volumes.value!, normal), dot(measure.points[0]!, normal)),
    });
    this.dropMeasure();
  }
  dropMeasure(): void {
    this.measure.value = null;
    this.measureAnchor.value = null;
  }
}
