// Touching in one picture: a press puts the tip on the surface under the cursor, a drag strokes over it.

import { toast } from "../base/announce.js";
import type { Vec3 } from "../base/geometry.js";
import { Flag, type Pose } from "../protocol/wire.js";
import { words } from "../words/words.js";
import type { PointerDevice } from "../state/pointer.js";
import type { Session } from "../state/session.js";
import type { SurfaceDrag, SurfacePoint } from "./surface_drag.js";
import { LazyModule } from "../words/lazy_module.js";

/** Factor of the chosen force per step of the wheel. */
const WHEEL_FACTOR = 1.15;
/** Range of the chosen force. */
export const PRESS_N: [number, number] = [0.1, 3];

type Position = [number, number];
/** Properties of a pointer event that a press depends on. */
type Pressing = Pick<PointerEvent, "pointerType" | "pressure">;
/** Press by a key, which has no pressure of its own. */
const KEY: Pressing = { pointerType: "", pressure: 0 };

const strokes = new LazyModule("stroke", () => import("./surface_drag.js"));

export class Touching {
  stroke: SurfaceDrag | null = null; // stroke of the current press
  private hadSurface = true; // the latest movement was over a surface

  /**
   * @param pick  finds the surface under a position of the cursor, canvas pixels; null: none
   * @param hover  position under the cursor without a surface, given the end of the path so far
   * @param nothing  message for a press on no surface
   */
  constructor(
    private readonly session: Session,
    private readonly pointer: PointerDevice,
    private readonly pick: (at: Position, stroke: SurfaceDrag) => SurfacePoint | null,
    private readonly hover: (at: Position, end: Vec3) => Vec3,
    private readonly nothing: () => string,
  ) {
    session.onPose((pose) => this.watch(pose));
  }

  /** Loads what a stroke needs; a press before that touches nothing. */
  static async load(): Promise<void> {
    await strokes.get();
  }

  /** Whether a structure with contact forces is at a position, patient frame. */
  readonly isTouchable = (p: Vec3): boolean => {
    const scene = this.session.scene.peek(),
      volumes = this.session.volumes.peek();
    const structureIndex = volumes?.structureAt(p) ?? null;
    return structureIndex !== null && scene!.tissues[scene!.structures[structureIndex]!.tissue]?.touchable === true;
  };

  /** Whether a press in this picture moves the tip. */
  get isOn(): boolean {
    return this.stroke !== null;
  }

  press(event: Pressing, at: Position): void {
    const { session, pointer } = this;
    const device = session.pose.peek()?.devices[0];
    if (!device) return;
    this.cursor = [at, at];
    if (!strokes.value) return void strokes.get();
    this.stroke = new strokes.value.SurfaceDrag(
      session.volumes.peek()!,
      this.isTouchable,
      device.tip,
      session.toolOf(device).radius_mm,
      (fraction, end) => this.hover(this.cursorAt(fraction), end),
    );
    this.setPressure(event);
    const path = this.stroke.begin((fraction) => this.pick(this.cursorAt(fraction), this.stroke!));
    pointer.hold(path, event.pointerType === "touch");
    this.report(true);
  }
  /**
   * Follows the cursor, also through the positions that a slow picture has not shown.
   * @param at  position of an event, canvas pixels
   */
  drag(event: PointerEvent, at: (event: PointerEvent) => Position): void {
    const { stroke } = this;
    if (!stroke) return;
    this.setPressure(event);
    const passed = event.getCoalescedEvents?.() ?? [];
    for (const each of passed.length > 0 ? passed : [event]) this.moveCursor(stroke, at(each));
    this.report(false);
  }
  /**
   * Moves the cursor of keys, which presses at its first position.
   * @param at  canvas pixels
   */
  step(at: Position): void {
    if (!this.stroke) return this.press(KEY, at);
    this.moveCursor(this.stroke, at);
    this.report(false);
  }
  private moveCursor(stroke: SurfaceDrag, to: Position): void {
    const [x, y] = this.cursor[1];
    this.cursor = [[x, y], to];
    const path = stroke.follow(
      (fraction) => this.pick(this.cursorAt(fraction), stroke),
      Math.hypot(to[0] - x, to[1] - y),
    );
    this.pointer.follow(path);
    this.session.isTransferring.value = stroke.isTransferring;
    if (path.some(({ isSetDown }) => isSetDown)) toast(words.setDown);
  }
  /** Changes the chosen force: more with the wheel towards the user. */
  wheel(deltaY: number): void {
    const { press_N } = this.session;
    press_N.value = Math.min(
      PRESS_N[1],
      Math.max(PRESS_N[0], press_N.value * (deltaY > 0 ? WHEEL_FACTOR : 1 / WHEEL_FACTOR)),
    );
  }
  release(): void {
    if (!this.stroke) return;
    this.stroke = null;
    this.session.isTransferring.value = false;
    this.pointer.release();
  }

  // latest movement of the cursor, canvas pixels
  private cursor: [Position, Position] = [
    [0, 0],
    [0, 0],
  ];
  private cursorAt(fraction: number): Position {
    const [[x, y], [to_x, to_y]] = this.cursor;
    return [x + fraction * (to_x - x), y + fraction * (to_y - y)];
  }
  /** A pen at half pressure presses with the chosen force. */
  private setPressure({ pointerType, pressure }: Pressing): void {
    this.pointer.pressure = pointerType === "pen" && pressure > 0 ? 2 * pressure : 1;
  }
  /** Reports that the tip is lifted, or why a press touches nothing. */
  private report(isPress: boolean): void {
    const hasSurface = this.stroke!.point !== null;
    if (!hasSurface && (isPress || this.hadSurface)) toast(isPress ? this.nothing() : words.lifted);
    this.hadSurface = hasSurface;
  }
  /** Frees a contact that something holds back. */
  private watch(pose: Pose): void {
    const { stroke, pointer } = this;
    const device = pose.devices[0];
    if (!stroke || !pointer.position || !device) return;
    const isInside = (device.flags & Flag.inside) !== 0;
    const touches = !isInside && (device.flags & Flag.contact) !== 0;
    const path = stroke.freed(
      performance.now(),
      pointer.position,
      touches ? { at: device.proxy, normal: device.normal, isRigid: !this.session.isDeformed.peek() } : null,
      device.tip,
      isInside,
    );
    this.session.isTransferring.value = stroke.isTransferring;
    if (!path) return;
    pointer.divert(path);
    toast(words.setDown);
  }
}
