// Mouse, pen or finger as haptic device: sends target positions of the tip, repeated at rest.

import type { Connection } from "../protocol/connection.js";
import { scale, add, sub, length, type Vec3 } from "../base/geometry.js";
import type { Permissions } from "./permissions.js";
import type { Requests } from "./requests.js";
import type { Session } from "./session.js";

const LEAST_INTERVAL_MS = 1000 / 120;
/** Repetition interval at rest. The server fades the force out after 100 ms without messages. */
const KEEP_ALIVE_MS = 1000 / 30;
/** Delay of the first message of a touch, because a second finger may follow for zooming. */
const PINCH_MS = 150;
/** Maximum speed of the tip, about that of a hand, at which it also moves to a distant click. */
const MOST_SPEED_MM_PER_S = 300;

export class PointerDevice {
  position: Vec3 | null = null; // target position sent last while the tip is held, patient frame; null: released
  private way: Vec3[] = []; // remaining waypoints; the last one is the target
  private sent_ms = 0; // time of the latest message
  private timer = 0;
  private isAwaited = false; // this page has requested the pointer for the current press

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly permissions: Permissions,
    private readonly requests: Requests,
  ) {}

  private get isTaken(): boolean {
    return this.session.state.value?.pointer === true;
  }
  /** Whether a press moves the tip: this page has the pointer, or may take it because no viewer has it. */
  get isAvailable(): boolean {
    return this.isTaken || (this.session.state.value?.pointer_by === null && this.permissions.device.value);
  }

  /**
   * Begins to move the tip to `p`, patient frame; takes the pointer first, if no viewer has it.
   * @param over  waypoints before `p`
   */
  hold(p: Vec3, isFinger: boolean, over: Vec3[] = []): void {
    // presses in two pictures at once are ambiguous
    if (this.session.holding.value) return this.release();
    this.position = this.session.pose.value?.devices[0]?.tip ?? p;
    this.way = [...over, p];
    this.session.holding.value = true;
    this.sent_ms = performance.now() + (isFinger ? PINCH_MS : 0);
    clearInterval(this.timer);
    this.timer = window.setInterval(() => this.send(), LEAST_INTERVAL_MS);
    this.isAwaited = !this.isTaken;
    if (this.isAwaited)
      void this.requests.once({ type: "pointer", take: true }).then((isGranted) => isGranted || this.release());
  }
  move(p: Vec3): void {
    if (this.session.holding.value) this.way[this.way.length - 1] = p;
  }
  release(): void {
    clearInterval(this.timer);
    this.position = null;
    this.session.holding.value = false;
  }

  private send(): void {
    if (!this.position) return;
    const now = performance.now();
    if (!this.isTaken) {
      if (this.isAwaited) this.sent_ms = Math.max(this.sent_ms, now);
      else this.release(); // a teacher has passed the pointer to another page
      return;
    }
    this.isAwaited = false;
    const elapsed = now - this.sent_ms;
    let way = sub(this.way[0]!, this.position);
    while (length(way) < 1e-3 && this.way.length > 1) {
      this.way.shift();
      way = sub(this.way[0]!, this.position);
    }
    const rests = length(way) < 1e-3;
    if (elapsed < (rests ? KEEP_ALIVE_MS : LEAST_INTERVAL_MS)) return;
    const most = (MOST_SPEED_MM_PER_S * Math.min(elapsed, 50)) / 1000;
    this.position = length(way) > most ? add(this.position, scale(way, most / length(way))) : this.way[0]!;
    this.connection.moveTip(this.position);
    this.sent_ms = now;
  }
}
