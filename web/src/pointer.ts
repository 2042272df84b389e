// The mouse, pen or finger as the haptic device: it says where the tip is to be, and says it again while it rests.

import type { Connection } from "./connection.js";
import { scale, add, sub, length, type Vec3 } from "./geometry.js";
import type { Session } from "./session.js";

const LEAST_INTERVAL_MS = 1000 / 120;
/** A resting pointer says where it is: the server lets the force fade after 100 ms of silence. */
const KEEP_ALIVE_MS = 1000 / 30;
/** A finger moves nothing for so long: a second one may come, to zoom. */
const PINCH_MS = 150;
/** No hand is faster: a click far from the tip leads it there. */
const MOST_SPEED_MM_PER_S = 300;

export class PointerDevice {
  position: Vec3 | null = null; // of the tip that is asked for, patient, while it is held
  private way: Vec3[] = []; // where it goes: over these, and to the last of them
  private sent_ms = 0; // and no sooner than that is anything sent
  private timer = 0;

  constructor(private readonly session: Session, private readonly connection: Connection) {}

  get isTaken(): boolean {
    return this.session.state?.pointer === true;
  }

  /** @param over  where it goes first */
  hold(p: Vec3, isFinger: boolean, over: Vec3[] = []): void {
    // somebody presses in two pictures: that is no place for the tip
    if (this.session.holding) return this.release();
    this.position = this.session.pose?.devices[0]?.tip ?? p;
    this.way = [...over, p];
    this.session.holding = true;
    this.sent_ms = performance.now() + (isFinger ? PINCH_MS : 0);
    clearInterval(this.timer);
    this.timer = window.setInterval(() => this.send(), LEAST_INTERVAL_MS);
    this.session.touch();
  }
  move(p: Vec3): void {
    if (this.session.holding) this.way[this.way.length - 1] = p;
  }
  release(): void {
    clearInterval(this.timer);
    this.position = null;
    this.session.holding = false;
    this.session.touch();
  }

  private send(): void {
    if (!this.position) return;
    const now = performance.now();
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
