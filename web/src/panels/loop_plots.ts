// Plots of the force and of the loop's rate and lateness, with their current figures.

import { byId, write } from "../base/dom.js";
import { limitQuantity, quantity } from "../words/figures.js";
import { length } from "../base/geometry.js";
import { Plot } from "./plots.js";
import type { Session } from "../state/session.js";
import type { Pose } from "../protocol/wire.js";
import { words } from "../words/words.js";

/** Minimum interval between samples of rate and lateness. */
const SLOW_S = 0.2;

export class LoopPlots {
  private readonly force = new Plot(byId("plot-force"), ["--limit", "--force"], 10, 0.5);
  private readonly late = new Plot(byId("plot-late"), ["--lateness", "--accent"], 60, 10);
  private readonly rate = new Plot(byId("plot-rate"), ["--speed"], 60, 100);
  private slow_s = -Infinity; // time of the latest sample of rate and lateness

  constructor(private readonly session: Session) {
    session.onPose((pose) => this.add(pose));
    session.onFigures(() => {
      if (session.pose.value) this.showFigures(session.pose.value);
      for (const plot of [this.force, this.late, this.rate]) plot.draw();
    });
  }

  private add(pose: Pose): void {
    const device = pose.devices[0]!;
    this.force.push(pose.time, [device.forceLimit, length(device.force)]);
    if (pose.time >= this.slow_s + SLOW_S || pose.time < this.slow_s) {
      this.slow_s = pose.time;
      this.late.push(pose.time, [pose.lateness.p99, pose.lateness.p50]);
      this.rate.push(pose.time, [pose.rate]);
    }
  }

  private showFigures(pose: Pose): void {
    const device = pose.devices[0]!;
    const set_N = this.session.state.value?.max_force_N ?? device.forceLimit;
    const rate = pose.rate.toFixed(0),
      p50 = pose.lateness.p50.toFixed(0),
      p99 = pose.lateness.p99.toFixed(0);
    write(byId("loop"), words.loop(rate, p50, p99, String(pose.skipped), String(pose.dropped)));
    write(
      byId("plot-force-value"),
      words.figureOf(quantity(length(device.force), "N"), limitQuantity(device.forceLimit, set_N)),
    );
    write(byId("plot-late-value"), words.lateness(p50, p99));
    write(byId("plot-rate-value"), rate);
  }
}
