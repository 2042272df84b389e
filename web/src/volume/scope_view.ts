// Arthroscopic view of the volume: the camera is on the tool's shaft, or moved from there by keys, mouse or touch.

import { element } from "../base/dom.js";
import { quantity } from "../words/figures.js";
import {
  add,
  dot,
  length,
  normalize,
  orientationLetters,
  rotate,
  scale,
  spread,
  sub,
  type Vec3,
} from "../base/geometry.js";
import type { History } from "../state/history.js";
import { LivePicture } from "./live_picture.js";
import { drawAge, drawLetters, drawSide, drawTool, text, touchedText } from "../drawing/overlay.js";
import { drawNoGoWarning } from "../drawing/no_go_marks.js";
import { Picture } from "../drawing/picture.js";
import { BACK_MM, HALF_FIELD_DEG, OPTICS_DEG, Scope, standOff, type ScopeFrame, type ScopePlacement } from "./scope.js";
import type { PointerDevice } from "../state/pointer.js";
import { readable, type Session } from "../state/session.js";
import { Touching } from "../touch/touching.js";
import { firstTouchable } from "../touch/surface.js";
import type { View } from "./view.js";
import type { VolumeRenderer } from "./volume_renderer.js";
import type { DevicePose, Pose } from "../protocol/wire.js";
import { setMessages, words } from "../words/words.js";

/** Near clipping distance, which keeps a surface in contact from blocking the view. */
const MIN_DISTANCE_MM = 0.5;
/** Distance at which the light at the camera has halved, as a depth cue. */
const REACH_MM = 40;
const TANGENT = Math.tan((HALF_FIELD_DEG * Math.PI) / 180);
const KEY_TURN_RAD = (5 * Math.PI) / 180;
const KEY_POST_DEG = 15;
const KEY_STEP_MM = 1;
const DRAG_RAD_PER_PIXEL = 0.004;
const WHEEL_MM = 0.02; // advance per unit of wheel movement
const PINCH_MM = 30; // advance when the distance between two fingers grows by a factor of e
/** Unit directions in which occlusion around a position is sampled. */
const AROUND: Vec3[] = Array.from(
  { length: 27 },
  (_, n) => [(n % 3) - 1, (Math.floor(n / 3) % 3) - 1, Math.floor(n / 9) - 1] as Vec3,
)
  .filter((v) => length(v) > 0)
  .map(normalize);

/** Pose of the camera; `off_mm`: distance by which it is retracted from the contact, null on the shaft. */
interface CameraPlacement extends ScopeFrame {
  off_mm: number | null;
}

/** View of a square picture of `size` x `size` pixels. */
export function scopeView({ eye, forward, right, up }: ScopeFrame, size: number): View {
  const corner = add(add(eye, forward), add(scale(right, -TANGENT), scale(up, TANGENT)));
  const step = (2 * TANGENT) / size;
  return {
    width: size,
    height: size,
    corner,
    across: scale(right, step),
    down: scale(up, -step),
    into: forward,
    eye: { at: eye, nearest_mm: MIN_DISTANCE_MM, reach_mm: REACH_MM, isRound: true },
    cut: null,
    isFine: true,
  };
}

export class ScopeView {
  readonly picture = new Picture("scope");
  readonly scope = new Scope();
  caption = ""; // text displayed in the picture
  private readonly live: LivePicture<CameraPlacement>;
  private readonly pointers = new Map<number, [number, number]>();
  private readonly holder = setMessages(element("select", { className: "small", hidden: true }), {
    label: "scopeHolder",
    title: "scopeHolder",
  });
  private readonly toTip = setMessages(element("button", { type: "button", className: "small" }), {
    text: "scopeToTip",
    title: "scopeToTipTitle",
  });

  private gesture = 0; // undo group of movements of the camera
  private readonly setTo: (to: ScopePlacement) => void;
  private readonly touching: Touching;

  constructor(
    private readonly session: Session,
    private readonly renderer: VolumeRenderer,
    isSoftware: boolean,
    private readonly history: History,
    private readonly pointer: PointerDevice,
  ) {
    this.touching = new Touching(
      session,
      pointer,
      (at, stroke) =>
        this.isInField(at) ? stroke.surfaceAlong(this.rayAt(at), this.touching.isTouchable, MIN_DISTANCE_MM) : null,
      (at, end) => {
        const { eye, forward } = this.frame()!;
        const { into } = this.rayAt(at);
        return add(eye, scale(into, dot(sub(end, eye), forward) / dot(into, forward)));
      },
      () => words.nothingThere,
    );
    this.live = new LivePicture(this.picture, renderer, isSoftware, true, () => this.drawOver());
    const optics = setMessages(
      element("select", { className: "small" }, ...OPTICS_DEG.map((angle) => new Option(`${angle}°`, String(angle)))),
      { label: "optics", title: "optics" },
    );
    optics.value = String(this.scope.optics_deg);
    optics.addEventListener("change", () =>
      this.change("optics", () => (this.scope.optics_deg = Number(optics.value))),
    );
    const back = setMessages(
      element("select", { className: "small" }, ...BACK_MM.map((mm) => new Option(`${mm} mm`, String(mm)))),
      { label: "scopeBack", title: "scopeBack" },
    );
    back.value = String(this.scope.back_mm);
    back.addEventListener("change", () => this.change("back", () => (this.scope.back_mm = Number(back.value))));
    this.holder.addEventListener("change", () =>
      this.change("tool", () => (this.scope.tool = Number(this.holder.value))),
    );
    this.setTo = (to) => {
      Object.assign(this.scope, to);
      [optics.value, back.value] = [String(to.optics_deg), String(to.back_mm)];
      this.offerHolders();
    };
    history.register("scope", () => this.scope.placement, this.setTo);
    const turns = (
      [
        ["↺", -KEY_POST_DEG, ","],
        ["↻", KEY_POST_DEG, "."],
      ] as const
    ).map(([sign, by, key]) => {
      const button = setMessages(
        element("button", { type: "button", className: "small", textContent: sign }),
        { label: "turnOptics", title: "turnOptics" },
        key,
      );
      button.addEventListener("click", () => this.change("post", () => this.scope.turnPost(by)));
      return button;
    });
    this.toTip.addEventListener("click", () => this.change("tip", () => this.scope.toTip()));
    this.picture.head.append(back, optics, this.holder, ...turns, this.toTip);
    this.listen();
  }

  /** Sets up the scope of a task, on the shaft of the default device. */
  setUp(optics_deg: number, back_mm: number): void {
    this.change("task", () => this.setTo({ tool: null, optics_deg, back_mm, post_deg: 0, free: null }));
  }

  /**
   * Changes the view, undoably.
   * @param gesture  changes with equal `by` and gesture are one undo step
   */
  private change(by: string, act: () => void, gesture = ++this.history.gesture): void {
    this.history.change(`scope ${by}`, act, gesture);
  }
  lost(): void {
    this.live.lost();
  }

  /** Number of the device that holds the scope; by default the second one, if there are several. */
  private get scopeDevice(): number {
    const devices = this.session.scene.value?.tools.length ?? 1;
    return this.scope.tool !== null && this.scope.tool < devices ? this.scope.tool : Math.min(1, devices - 1);
  }
  private offerHolders(): void {
    const scene = this.session.scene.value;
    if (!scene) return;
    const names = scene.tools.map(({ name }, n) => `${n + 1}: ${words.toolNamed(name)}`);
    if (names.some((name, n) => this.holder.options[n]?.text !== name) || this.holder.length > names.length)
      this.holder.replaceChildren(...names.map((name, n) => new Option(name, String(n))));
    this.holder.hidden = names.length < 2;
    this.holder.value = String(this.scopeDevice);
  }

  get isSharp(): boolean {
    return this.live.isSharp;
  }
  /** Current pose of the camera; null until the tool's pose is known. */
  frame(): CameraPlacement | null {
    const pose = this.session.pose.value;
    const device = pose?.devices.find(({ number }) => number === this.scopeDevice);
    if (!pose || !device) return null;
    const axes = (
      [
        [1, 0, 0],
        [0, 1, 0],
        [0, 0, 1],
      ] as Vec3[]
    ).map((axis) => this.session.toPatient(pose, rotate(device.orientation, axis)));
    const onShaft = this.scope.frame(this.session.toolAt(device), axes as [Vec3, Vec3, Vec3]);
    return { ...onShaft, ...this.standOff(pose, device, onShaft.eye) };
  }
  /**
   * Position of the camera: on the shaft, or, if the view from there is blocked by a solid, retracted from the contact
   * by the necessary distance.
   */
  private standOff(pose: Pose, device: DevicePose, onShaft: Vec3): { eye: Vec3; off_mm: number | null } {
    const { session, scope } = this;
    const stays = { eye: onShaft, off_mm: null };
    if (scope.isFree || !session.volumes.value || !this.isClosed(onShaft)) return stays;
    const away = normalize(length(device.normal) > 0 ? device.normal : session.toPatient(pose, device.force));
    const tool = session.toolAt(device);
    const { voxelSize } = session.volumes.value;
    const at = (off_mm: number) => add(tool, scale(away, off_mm));
    const off_mm =
      length(away) > 0
        ? standOff((off) => this.isClosed(at(off)), scope.back_mm, MIN_DISTANCE_MM + voxelSize, voxelSize / 8)
        : null;
    return off_mm === null ? stays : { eye: at(off_mm), off_mm };
  }
  /** Whether an eye at a position is inside a solid, or solids surround more than half of it at MIN_DISTANCE_MM. */
  private isClosed(eye: Vec3): boolean {
    const volumes = this.session.volumes.value,
      appearances = this.session.appearances.value;
    const isSolid = (p: Vec3) => {
      const structure = volumes!.structureAt(p);
      return structure !== null && appearances[structure]!.visible && appearances[structure]!.opacity === 1;
    };
    return (
      isSolid(eye) ||
      2 * AROUND.filter((direction) => isSolid(add(eye, scale(direction, MIN_DISTANCE_MM)))).length > AROUND.length
    );
  }

  draw(now: number): void {
    if (this.requestPicture(now)) this.drawOver();
  }
  /**
   * Requests a picture if needed.
   * @returns whether the picture is visible
   */
  requestPicture(now: number): boolean {
    const { session, picture } = this;
    const resized = picture.fit();
    const frame = picture.isShown && session.volumes.value && session.scene.value ? this.frame() : null;
    if (!frame) return false;
    if (resized) this.live.show();
    this.offerHolders();
    this.toTip.disabled = !this.scope.isFree;
    const { width, height, ratio } = picture.frame();
    const size = Math.min(width, height);
    this.renderer.follow(session);
    this.live.update(now, JSON.stringify([frame, size, this.renderer.version]), this.pointers.size > 0, () => ({
      camera: frame,
      view: (reduction) => scopeView(frame, Math.max(16, Math.round(size / ratio / reduction))),
    }));
    return true;
  }

  /** Name of the structure that contains the camera; null: none. */
  private get around(): string | null {
    const found = this.live.latest?.found;
    if (!found) return null;
    const steps = Array.from({ length: 9 }, (_, n) => (n + 0.5) / 9);
    const all = steps
      .flatMap((y) => steps.map((x) => [x, y] as const))
      .filter(([x, y]) => Math.hypot(x - 0.5, y - 0.5) < 0.48);
    const inside = all
      .map(([x, y]) => found.at(x, y))
      .filter((met) => met !== null && met.way_mm < MIN_DISTANCE_MM + 0.05);
    if (inside.length < all.length / 2) return null;
    return readable(this.session.nameAt(inside[inside.length >> 1]!.structure));
  }

  /** Text about the camera's position and the centre of its view. */
  private where(): string {
    const { scope } = this;
    const { found, camera } = this.live.latest!;
    const ahead = found.at(0.5, 0.5);
    const placement = scope.isFree
      ? words.movedFromTip
      : [
          camera.off_mm !== null
            ? words.offTouched(quantity(camera.off_mm, "mm"))
            : scope.back_mm > 0
              ? words.behindTip(`${scope.back_mm} mm`)
              : words.scopeAtTip,
          `${scope.optics_deg}°`,
          ...(scope.optics_deg > 0 ? [words.post(`${scope.post_deg}°`)] : []),
        ].join(", ");
    return ahead
      ? `${placement} · ${words.ahead(quantity(ahead.way_mm, "mm"), readable(this.session.nameAt(ahead.structure)))}`
      : placement;
  }

  private drawOver(): void {
    const { session, scope } = this;
    const frame = this.picture.frame();
    const { context, width, height, ratio } = frame;
    const seen = this.live.latest;
    context.clearRect(0, 0, width, height);
    if (!seen || !session.scene.value) return;
    const { eye, forward, right, up } = seen.camera;
    const [x, y, radius] = [width / 2, height / 2, Math.min(width, height) / 2];
    const around = this.around;
    const device = session.pose.value?.devices[0];

    context.save();
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    if (around) {
      context.fillStyle = "#14191d";
      context.fill();
    }
    context.clip();
    for (const each of session.drawn) {
      // the tool that holds the camera is not drawn while the camera is at its tip
      if (each.number === this.scopeDevice && !scope.isFree && scope.back_mm === 0) continue;
      const depth = (p: Vec3) => Math.max(dot(sub(p, eye), forward), 0.01);
      const pixelsPerMm = (p: Vec3) => radius / TANGENT / depth(p);
      const tool = session.toolAt(each);
      if (dot(sub(tool, eye), forward) > MIN_DISTANCE_MM) {
        drawTool(frame, session, each, {
          pixel: (p) => [x + dot(sub(p, eye), right) * pixelsPerMm(p), y - dot(sub(p, eye), up) * pixelsPerMm(p)],
          direction: (v) => [dot(v, right), -dot(v, up)],
          pixelsPerMm,
          // the tool that holds the camera is behind the lens, but for its head
          hasBodies: each.number !== this.scopeDevice,
          clearness: (p) =>
            seen.found.hides(p, session.toolOf(each).radius_mm + 1.5 * session.volumes.value!.voxelSize) ? 0.45 : 1,
        });
      }
    }
    context.restore();

    // border of the round field of view, with a mark in the direction of tilt
    context.beginPath();
    context.arc(x, y, radius - ratio, 0, 2 * Math.PI);
    context.lineWidth = 2 * ratio;
    context.strokeStyle = "#3a4750";
    context.stroke();
    if (!scope.isFree && scope.optics_deg > 0) {
      const post = (scope.post_deg * Math.PI) / 180;
      const at = (along: number, across: number): [number, number] => [
        x + along * Math.sin(post) + across * Math.cos(post),
        y - along * Math.cos(post) + across * Math.sin(post),
      ];
      context.beginPath();
      context.moveTo(...at(radius - 14 * ratio, 0));
      context.lineTo(...at(radius, -7 * ratio));
      context.lineTo(...at(radius, 7 * ratio));
      context.closePath();
      context.fillStyle = "#eef3f5";
      context.fill();
    }

    this.caption = around ? words.insideOf(around) : this.where();
    if (around) text(frame, this.caption, x, y, 14, "#f5c277", "center", "middle");
    else text(frame, this.caption, 12 * ratio, 58 * ratio, 12, "#eef3f5", "left", "top");
    if (device)
      text(
        frame,
        touchedText(session, device),
        12 * ratio,
        40 * ratio,
        12,
        session.isFresh.value ? "#eef3f5" : "#a4adb3",
        "left",
        "top",
      );
    drawLetters(frame, orientationLetters(right, scale(up, -1)), session.scene.value.oriented, true);
    drawSide(frame, session.scene.value);
    drawNoGoWarning(frame, session, 78);
    drawAge(frame, session);
  }

  /** Ray through a canvas position. */
  private rayAt([x, y]: [number, number]): { from: Vec3; into: Vec3 } {
    const { eye, forward, right, up } = this.frame()!;
    const { width, height } = this.picture.frame();
    const radius = Math.min(width, height) / 2;
    const across = ((x - width / 2) / radius) * TANGENT,
      upwards = ((height / 2 - y) / radius) * TANGENT;
    return { from: eye, into: normalize(add(forward, add(scale(right, across), scale(up, upwards)))) };
  }
  private isInField([x, y]: [number, number]): boolean {
    const { width, height } = this.picture.frame();
    return Math.hypot(x - width / 2, y - height / 2) < Math.min(width, height) / 2;
  }
  /** Whether a surface with contact forces is under a position in the round field of view. */
  private hasSurface(at: [number, number]): boolean {
    const { from, into } = this.rayAt(at);
    return (
      this.isInField(at) &&
      firstTouchable(this.session.volumes.value!, this.touching.isTouchable, from, into, MIN_DISTANCE_MM) !== null
    );
  }
  /** Whether a press touches: the first pointer, with the tool for it, on a surface. */
  private isTouch(event: PointerEvent): boolean {
    const { session, pointer, pointers, picture } = this;
    return (
      session.tool.value === "touch" &&
      pointer.isAvailable &&
      event.button === 0 &&
      pointers.size === 1 &&
      this.frame() !== null &&
      this.hasSurface(picture.at(event))
    );
  }

  private move(right_rad: number, up_rad: number, ahead_mm: number, gesture = this.gesture, by = "move"): void {
    const from = this.frame();
    if (from) this.change(by, () => this.scope.move(from, right_rad, up_rad, ahead_mm), gesture);
  }

  private listen(): void {
    const { picture } = this;
    const surface = picture.surface;
    surface.addEventListener("contextmenu", (event) => event.preventDefault());
    surface.addEventListener("pointerdown", (event) => {
      surface.setPointerCapture(event.pointerId);
      surface.focus({ preventScroll: true });
      this.pointers.set(event.pointerId, picture.at(event));
      if (this.pointers.size === 1) this.gesture = ++this.history.gesture;
      if (this.isTouch(event)) {
        // a camera on the shaft of the tip would move with the stroke
        this.move(0, 0, 0, this.gesture, "touch");
        this.touching.press(event, picture.at(event));
      } else if (this.pointers.size > 1) this.touching.release();
    });
    surface.addEventListener("pointermove", (event) => {
      const before = this.pointers.get(event.pointerId);
      if (!before) return;
      const at = picture.at(event);
      const { ratio } = picture.frame();
      if (this.touching.isOn) this.touching.drag(event, (each) => picture.at(each));
      else if (this.pointers.size === 2) {
        const other = [...this.pointers].find(([id]) => id !== event.pointerId)![1];
        this.move(0, 0, PINCH_MM * Math.log(spread(other, before, at)));
      } else if (this.pointers.size === 1)
        this.move(
          (-(at[0] - before[0]) / ratio) * DRAG_RAD_PER_PIXEL,
          ((at[1] - before[1]) / ratio) * DRAG_RAD_PER_PIXEL,
          0,
        );
      this.pointers.set(event.pointerId, at);
    });
    const up = (event: PointerEvent) => {
      this.pointers.delete(event.pointerId);
      this.touching.release();
    };
    surface.addEventListener("pointerup", up);
    surface.addEventListener("pointercancel", up);
    surface.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        // successive wheel events are one undo step
        if (this.touching.isOn) this.touching.wheel(event.deltaY);
        else this.move(0, 0, -event.deltaY * WHEEL_MM, this.history.gesture, "wheel");
      },
      { passive: false },
    );
    surface.addEventListener("keydown", (event) => {
      const turn = (by_deg: number) => this.change("post", () => this.scope.turnPost(by_deg), this.gesture);
      const keys: Record<string, () => void> = {
        ArrowLeft: () => this.move(-KEY_TURN_RAD, 0, 0),
        ArrowRight: () => this.move(KEY_TURN_RAD, 0, 0),
        ArrowUp: () => this.move(0, KEY_TURN_RAD, 0),
        ArrowDown: () => this.move(0, -KEY_TURN_RAD, 0),
        "+": () => this.move(0, 0, KEY_STEP_MM),
        "=": () => this.move(0, 0, KEY_STEP_MM),
        "-": () => this.move(0, 0, -KEY_STEP_MM),
        ",": () => turn(-KEY_POST_DEG),
        ".": () => turn(KEY_POST_DEG),
        Home: () => this.change("tip", () => this.scope.toTip()),
      };
      const action = keys[event.key];
      if (!action || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      // the repeats of a key are one undo step
      if (!event.repeat) this.gesture = ++this.history.gesture;
      action();
    });
  }

  /** Picture of a scope at a pose: RGBA by rows from the top. */
  async pixels(frame: ScopeFrame, size: number): Promise<Uint8ClampedArray> {
    await this.renderer.loaded;
    this.renderer.follow(this.session);
    return this.renderer.pixels(scopeView(frame, size));
  }
}
