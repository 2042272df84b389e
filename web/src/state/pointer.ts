// Mouse, pen or finger as haptic device: sends target positions of the tip, and the force to press with, repeated at
// rest.

import type { Connection } from "../protocol/connection.js";
import { Flag } from "../protocol/wire.js";
import { scale, add, sub, length, type Vec3 } from "../base/geometry.js";
import type { Permissions } from "./permissions.js";
import type { Requests } from "./requests.js";
import type { Session } from "./session.js";

/** Position on the path of the tip; patient frame. */
export interface PathPoint {
  at: Vec3;
  into: Vec3 | null; // unit direction to press in; null: no force
  /** The tip is here at once, without a path to it, and its contact is reset. */
  isSetDown?: boolean;
}

/** Distance from the cursor beyond which a contact does not show what the cursor points at. */
export const MAX_DISTANCE_MM = 3;
const MIN_INTERVAL_MS = 1000 / 120;
/** Repetition interval at rest. */
const KEEP_ALIVE_MS = 1000 / 30;
/** Interval without messages after which palpate lets the force fade out (docs/reference/devices-without-force.md). */
const HOLD_MS = 550;
/** Delay of the first message of a touch, because a second finger may follow for zooming. */
const PINCH_MS = 150;
/**
 * Speed of the tip in contact, about that of a hand. It is raised, up to MAX_MM_PER_S, so that the remaining path takes
 * at most MAX_PATH_MS.
 */
const SPEED_MM_PER_S = 300,
  MAX_PATH_MS = 60,
  MAX_MM_PER_S = 1800;
/** Maximum distance in contact between two messages, which palpate connects by a straight line. */
const MAX_CHORD_MM = 10;
/** Distance by which a released tip leaves the surface, and the time for that. */
const LEAVES_MM = 2,
  LEAVING_MS = 60;
/** Conditions under which palpate withholds the force, so that no depth would reach the chosen one. */
const NO_FORCE = Flag.emergencyStop | Flag.paused | Flag.halted;
/** Range of the force to press with; also limited to the session's force limit. */
export const MIN_PRESS_N = 0.1;

export class PointerDevice {
  position: PathPoint | null = null; // target sent last while the tip is held; null: released
  pressure = 1; // factor of the chosen force by the pressure of a pen
  /** Called when the hold ends although the press goes on. */
  onReleasedByPause: () => void = () => {};
  private remainingPath: PathPoint[] = []; // remaining path; the last step is the target
  private sent_ms = 0; // time of the latest message
  private hasSent = false; // the current hold has sent a message
  private hasPressed = false; // the current hold has reached a surface
  private timer = 0;
  private isAwaited = false; // this page has requested the pointer for the current press

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly permissions: Permissions,
    private readonly requests: Requests,
  ) {}

  private get isClaimed(): boolean {
    return this.session.state.value?.pointer === true;
  }
  /** Whether a press moves the tip: this page has the pointer, or may take it because no viewer has it. */
  get isAvailable(): boolean {
    return this.isClaimed || (this.session.state.value?.pointer_by === null && this.permissions.operateTool.value);
  }
  /** Force that a press has now, N. */
  private get force_N(): number {
    const { state, press_N } = this.session;
    return Math.max(MIN_PRESS_N, Math.min(press_N.value * this.pressure, state.value?.max_force_N ?? Infinity));
  }

  /** Begins to move the tip along a path; takes the pointer first, if no viewer has it. */
  hold(path: PathPoint[], isFinger: boolean): void {
    // presses in two pictures at once are ambiguous
    if (this.session.isPressing.value) return this.release();
    const tip = this.session.pose.value?.devices[0]?.tip;
    this.remainingPath = [...path];
    this.position = tip ? { at: tip, into: null } : (path[0] ?? null);
    if (!this.position) return;
    this.session.isPressing.value = true;
    this.hasSent = this.hasPressed = false;
    this.sent_ms = performance.now() + (isFinger ? PINCH_MS : 0);
    clearInterval(this.timer);
    this.timer = window.setInterval(() => this.send(), MIN_INTERVAL_MS);
    this.isAwaited = !this.isClaimed;
    if (this.isAwaited)
      void this.requests.once({ type: "pointer", take: true }).then((isGranted) => isGranted || this.release());
  }
  /** Replaces the remaining path. */
  move(step: PathPoint): void {
    if (this.session.isPressing.value) this.remainingPath = [step];
  }
  /** Replaces the remaining path by another one. */
  divert(path: PathPoint[]): void {
    if (this.session.isPressing.value) this.remainingPath = [...path];
  }
  /** Continues the path. */
  follow(path: PathPoint[]): void {
    if (this.session.isPressing.value) this.remainingPath.push(...path);
  }
  release(): void {
    clearInterval(this.timer);
    const { position, hasSent } = this;
    this.hasSent = false;
    this.position = null;
    this.session.isPressing.value = false;
    if (position && hasSent && this.isClaimed) this.retract(position);
  }
  /** Leaves the surface, which would stay dented, and releases the tip. */
  private retract({ at, into }: PathPoint): void {
    if (into) this.connection.moveTip(sub(at, scale(into, LEAVES_MM)));
    const lift = () => this.session.isPressing.value || this.connection.liftTip();
    if (into) window.setTimeout(lift, LEAVING_MS);
    else lift();
  }
  /** Releases the tip although the press goes on: the page was hidden or did not run for too long. */
  releaseByPause(): void {
    if (!this.session.isPressing.value) return;
    this.release();
    this.onReleasedByPause();
  }

  private send(): void {
    if (!this.position) return;
    const now = performance.now();
    if (!this.isClaimed) {
      if (this.isAwaited) this.sent_ms = Math.max(this.sent_ms, now);
      else this.release(); // a teacher has passed the pointer to another page
      return;
    }
    this.isAwaited = false;
    const elapsed = now - this.sent_ms;
    // palpate has let go meanwhile, and would begin inside of the tissue; on its way to the surface the tip goes on
    if (this.hasPressed && elapsed > HOLD_MS) return this.releaseByPause();
    if (elapsed < (this.remainingPath.length === 0 ? KEEP_ALIVE_MS : MIN_INTERVAL_MS)) return;
    this.sent_ms = now;
    this.hasSent = true;
    if (this.remainingPath[0]?.isSetDown) {
      this.position = this.remainingPath.shift()!;
      return this.connection.setTipDown(this.position.at);
    }
    this.advance(Math.min(elapsed, 50));
    this.hasPressed ||= this.position.into !== null;
    const isPressing = this.position.into && !((this.session.pose.value?.devices[0]?.flags ?? 0) & NO_FORCE);
    if (isPressing) this.connection.moveTip(this.position.at, this.position.into!, this.force_N);
    else this.connection.moveTip(this.position.at);
  }
  /** Moves the position along the path by the time since the previous message. */
  private advance(elapsed_ms: number): void {
    let from = this.position!;
    let left_mm = 0;
    if (this.hasPressed)
      for (const [n, step] of this.remainingPath.entries())
        if (!step.isSetDown) left_mm += length(sub(step.at, (this.remainingPath[n - 1] ?? from).at));
    const speed = Math.min(Math.max(SPEED_MM_PER_S, (1000 * left_mm) / MAX_PATH_MS), MAX_MM_PER_S);
    const path_mm = (speed * elapsed_ms) / 1000;
    for (let most_mm = from.into ? Math.min(path_mm, MAX_CHORD_MM) : path_mm; this.remainingPath.length > 0;) {
      const step = this.remainingPath[0]!;
      if (step.isSetDown) return;
      const path = sub(step.at, from.at);
      const far_mm = length(path);
      if (far_mm > most_mm) {
        // without force up to the surface that is pressed on
        this.position = { at: add(from.at, scale(path, most_mm / far_mm)), into: from.into && step.into };
        return;
      }
      most_mm -= far_mm;
      this.remainingPath.shift();
      const turns = !from.into || !step.into;
      from = this.position = step;
      // passes through the positions at which it leaves or meets a surface
      if (turns && far_mm > 0) return;
    }
  }
}
