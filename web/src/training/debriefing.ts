// Results of a run of a task: verdict, metrics, plots and events.

import { announce } from "../base/announce.js";
import { byId, element, write } from "../base/dom.js";
import { Plot } from "../panels/plots.js";
import type { Debriefing, Task, TaskEvent } from "../protocol/messages.js";
import { refusalText } from "../state/requests.js";
import { setMessages, words, type Message } from "../words/words.js";
import { seconds, type TaskTexts } from "./task_texts.js";

const MAX_EVENTS = 60;

export class DebriefingPanel {
  private plots: Plot[] = [];
  private shownRun = ""; // key of the displayed results
  private announcedRun = 0; // number of the run whose result was announced

  constructor(private readonly texts: TaskTexts) {}

  /** Forgets the displayed results: another connection may count runs from 1 again. */
  reset(): void {
    this.shownRun = "";
    this.announcedRun = 0;
    this.plots = [];
  }
  /** Redraws the plots, whose theme and size may change. */
  draw(): void {
    for (const plot of this.plots) plot.draw();
  }

  /**
   * Shows the results of a run, unless they are shown already.
   * @param liveRun  number of the run that was observed live; only its result is announced
   */
  show(task: Task, result: Debriefing, liveRun: number): void {
    const listing = [result.run, words.now].join();
    if (this.shownRun === listing) return;
    this.shownRun = listing;
    const isLive = liveRun === result.run && this.announcedRun !== result.run;
    byId("verdict").dataset.inBand = String(result.in_band);
    const row = words.inARow(String(result.in_a_row), String(task.in_a_row));
    const verdict = result.in_band ? `✓ ${words.runIn}` : `✗ ${words.runOut}`;
    write(byId("verdict"), `${verdict} · ${result.in_a_row >= task.in_a_row ? words.passed : row}`);
    write(
      byId("verdict-more"),
      [
        words.tookAndEnded(seconds(result.time_s), words.endedBy[result.end]),
        ...(result.missing_s > 0 ? [words.ticksMissing(seconds(result.missing_s))] : []),
        result.kept !== null
          ? words.storedAs(String(result.kept))
          : result.not_stored
            ? words.notStored(refusalText(result.not_stored))
            : words.storedNowhere,
        words.runsSoFar(String(result.runs)),
        words.ticksOfRun(String(result.first_tick), String(result.last_tick)),
      ].join(" "),
    );

    const advice = this.texts.advice(task, result);
    write(byId("improve"), advice);
    byId("improve").hidden = advice === "";

    if (isLive) announce([byId("verdict").textContent ?? "", ...(advice ? [advice] : [])].join(". "));
    this.announcedRun = result.run;
    const heads: Message[] = ["figure", "yours", "expertBand", "ownBest"];
    byId("figures").replaceChildren(
      setMessages(element("caption"), { text: "figuresAbout" }),
      element(
        "thead",
        {},
        element("tr", {}, ...heads.map((head) => setMessages(element("th", { scope: "col" }), { text: head }))),
      ),
      element(
        "tbody",
        {},
        ...task.metrics.map((metric, n) => {
          const { value, in_band, best } = result.metrics[n]!;
          const counts = metric.at_least !== null || metric.at_most !== null;
          const verdict = !counts
            ? []
            : [
                element("span", {
                  className: "verdict",
                  textContent: in_band ? `✓ ${words.metricIn}` : `✗ ${words.metricOut}`,
                }),
              ];
          const row = element(
            "tr",
            {},
            element("th", { scope: "row" }, this.texts.metricName(metric)),
            element("td", {}, element("span", {}, this.texts.metricValue(metric, value)), ...verdict),
            element(
              "td",
              {},
              element("span", {}, this.texts.bandText(metric)),
              ...(counts ? [element("span", { className: "quiet" }, metric.basis ?? words.notValidated)] : []),
            ),
            element("td", {}, best === null ? "–" : this.texts.metricValue(metric, best)),
          );
          if (counts) row.dataset.inBand = String(in_band);
          return row;
        }),
      ),
    );
    this.plotRun(task, result);

    const events = result.events.slice(0, MAX_EVENTS);
    const omitted = result.events.length - events.length + result.more_events;
    byId("run-events").replaceChildren(
      ...events.map((event) =>
        element(
          "li",
          {},
          element("span", { className: "mono" }, seconds(event.time_s)),
          ` ${this.mark(event)} `,
          this.texts.eventText(task, event),
        ),
      ),
      ...(omitted > 0 ? [element("li", { className: "quiet" }, words.moreEvents(String(omitted)))] : []),
    );
    byId("show-coverage-line").hidden = result.patches.length === 0;
  }
  private mark({ kind }: TaskEvent): string {
    return { step_done: "✓", over_limit: "▲", protected: "■", unseen: "◌", ended: "●" }[kind];
  }
  /** Plots each force of the task over time, or the total force if there are none. */
  private plotRun(task: Task, result: Debriefing): void {
    const shown =
      task.forces.length > 0
        ? task.forces
            .slice(0, 4)
            .map((force, n) => ({ name: this.texts.namesOf(force.labels), column: 5 + n, part: n, ...force }))
        : [{ name: words.allTouched, column: 4, part: -1, labels: [], band_N: null, limit_N: null }];
    const figures = shown.map(({ name }) => {
      const canvas = setMessages(element("canvas"), { label: "runPlotAbout" }, name);
      canvas.setAttribute("role", "img");
      return {
        canvas,
        figure: element("figure", {}, element("figcaption", {}, element("span", {}, words.runPlot(name))), canvas),
      };
    });
    byId("run-plots").replaceChildren(...figures.map(({ figure }) => figure));
    this.plots = shown.map(({ column, part, band_N, limit_N }, n) => {
      const plot = new Plot(
        figures[n]!.canvas,
        ["--force"],
        Math.max(result.time_s, 0.1),
        1.2 * Math.max(limit_N ?? 0, band_N?.[1] ?? 0, band_N?.[0] ?? 0, 0.5),
      );
      plot.band = band_N && [band_N[0], band_N[1] ?? Infinity];
      plot.limit = limit_N;
      plot.marks = result.events
        .filter(
          (event) =>
            event.kind === "step_done" ||
            (event.kind === "over_limit" && event.part === part) ||
            event.kind === "protected",
        )
        .slice(0, 200)
        .map((event) => ({
          time: event.time_s,
          text: this.mark(event),
          colour: event.kind === "step_done" ? "--good" : "--alert-text",
        }));
      for (const sample of result.samples) plot.push(sample[0]!, [sample[column] ?? 0]);
      return plot;
    });
  }
}
