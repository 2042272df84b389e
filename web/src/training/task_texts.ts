// Texts of a task, its events and its metrics.

import type { Debriefing, Task, TaskEvent, TaskMetric, TaskStep } from "../protocol/messages.js";
import type { Session } from "../state/session.js";
import { digits, quantity } from "../words/figures.js";
import { words } from "../words/words.js";

export const seconds = (s: number): string => `${s.toFixed(1)} s`;
const percent = (fraction: number): string => `${Math.round(1000 * fraction) / 10} %`;

export class TaskTexts {
  constructor(private readonly session: Session) {}

  namesOf(labels: number[]): string {
    if (this.session.quiz.value) return words.someStructure;
    const names = labels.map((label) => this.session.nameOf(label));
    return names.length > 3 ? words.andMore(names.slice(0, 3).join(", "), String(names.length - 3)) : names.join(", ");
  }
  stepText(step: TaskStep): string {
    const {
      force_N: [least, most],
      kind,
      coverage,
      seen,
    } = step;
    const time = `${step.seconds} s`;
    if (kind === "cover") return words.stepCover(percent(coverage));
    if (kind === "remove") return words.stepRemove(percent(coverage));
    if (kind === "visit") return words.stepVisit(time);
    const touch =
      most === null
        ? words.stepTouchLeast(quantity(least, "N"), time)
        : words.stepTouch(quantity(least, "N"), quantity(most, "N"), time);
    return seen ? words.inScope(touch) : touch;
  }
  rules(task: Task): string[] {
    const band = ([least, most]: [number, number | null]) =>
      most === null ? words.atLeast(quantity(least, "N")) : words.fromTo(quantity(least, "N"), quantity(most, "N"));
    return [
      ...task.forces.flatMap(({ labels, band_N, limit_N }) => [
        ...(band_N ? [words.ruleBand(this.namesOf(labels), band(band_N))] : []),
        ...(limit_N === null ? [] : [words.ruleLimit(this.namesOf(labels), quantity(limit_N, "N"))]),
      ]),
      ...task.protected.map(({ labels }) => words.ruleProtected(this.namesOf(labels))),
      ...(task.answer_s === null ? [] : [words.ruleAnswer(`${task.answer_s} s`)]),
      ...(task.time_limit_s === null ? [] : [words.ruleTime(`${task.time_limit_s} s`)]),
      task.ends_with_steps ? words.ruleEndsItself : words.ruleEndsByYou,
      words.ruleRow(String(task.in_a_row)),
    ];
  }
  eventText(task: Task, { kind, part, force_N }: TaskEvent): string {
    if (kind === "step_done") return words.stepIsDone(task.steps[part]?.name ?? "");
    if (kind === "over_limit")
      return words.wasOver(
        quantity(force_N, "N"),
        this.namesOf(task.forces[part]?.labels ?? []),
        quantity(task.forces[part]?.limit_N ?? 0, "N"),
      );
    if (kind === "protected")
      return words.wasProtected(this.namesOf(task.protected[part]?.labels ?? []), quantity(force_N, "N"));
    return kind === "unseen" ? words.wasUnseen(quantity(force_N, "N")) : words.taskOver;
  }
  metricName({ name, labels }: TaskMetric): string {
    const title = (words.metrics as Record<string, string>)[name] ?? name;
    return labels.length > 0 ? words.ofStructures(title, this.namesOf(labels)) : title;
  }
  metricValue({ name, unit }: TaskMetric, value: number | null): string {
    if (value === null) return words.noFigure;
    if (unit !== "1") return `${digits(value)} ${unit}`;
    return name === "smoothness" || name === "economy" ? digits(value) : percent(value);
  }
  bandText(metric: TaskMetric): string {
    const { at_least, at_most } = metric;
    const valueText = (value: number) => this.metricValue(metric, value);
    if (at_least !== null && at_most !== null) return words.fromTo(valueText(at_least), valueText(at_most));
    return at_least !== null
      ? words.atLeast(valueText(at_least))
      : at_most !== null
        ? words.atMost(valueText(at_most))
        : words.doesNotCount;
  }

  /** The first counted metric that is out of its band, as the advice for the next run; empty: all are in band. */
  advice(task: Task, result: Debriefing): string {
    const worst = task.metrics.findIndex(
      ({ at_least, at_most }, n) => (at_least !== null || at_most !== null) && !result.metrics[n]!.in_band,
    );
    if (worst < 0) return "";
    const metric = task.metrics[worst]!;
    const open = task.steps.find((_, n) => !result.done[n]);
    if (metric.name === "steps_done" && open) return words.adviceStep(open.name);
    return words.advice(
      this.metricName(metric),
      this.metricValue(metric, result.metrics[worst]!.value),
      this.bandText(metric),
    );
  }
}
