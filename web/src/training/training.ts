// Panel of tasks: briefing and progress, as measured and reported by palpate; debriefing.ts shows the results.

export * as Quiz from "./redaction.js"; // bundled in the same chunk
import { batch, effect, signal, untracked } from "@preact/signals-core";
import type { Scene, Debriefing, Task, TaskForce, TaskProgress, TaskScope } from "../protocol/messages.js";
import { announce } from "../base/announce.js";
import type { Connection } from "../protocol/connection.js";
import { byId, element, write } from "../base/dom.js";
import { quantity } from "../words/figures.js";
import type { Requests } from "../state/requests.js";
import type { Session } from "../state/session.js";
import { DebriefingPanel } from "./debriefing.js";
import { seconds, TaskTexts } from "./task_texts.js";
import { drawPatches, drawPosition, drawRegion, drawPath } from "./training_marks.js";
import type { VolumeView } from "../volume/volume_view.js";
import { setMessages, words } from "../words/words.js";

type View = "none" | "briefing" | "running" | "debriefing";
/** Minimum display time of a warning. */
const WARNING_MS = 1500;
const TOUCHED_N = 0.05;

/** Hides the structures, by label, to be found in a quiz; null: shows them again. */
export type Hide = (toFind: number[] | null) => void;

export class Training {
  view: View = "none";
  private readonly chosen = signal(""); // name of the selected task; "": none
  private readonly closedRun = signal(0); // number of the run whose results were closed
  private readonly viewedStep = signal(-1); // step whose region the camera shows; -1: none
  private shownTasks = ""; // key of the tasks in the menu
  private before: TaskProgress | null = null; // report before the current one
  private announcedEvents = 0; // number of events of the run that were announced
  private liveRun = 0;
  private warning = { text: "", until_ms: -Infinity };
  private listed = ""; // key of the displayed list of steps
  private tookFocus = false; // the panel had the focus before the run was stored
  private scopedRun = 0; // number of the run for which the scope was set
  private bars: { reading: HTMLElement; bar: HTMLElement; value: HTMLElement }[] = [];
  private readonly texts: TaskTexts;
  private readonly results: DebriefingPanel;

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly requests: Requests,
    private readonly volume: VolumeView,
    private readonly hide: Hide,
    private readonly setScope: (scope: TaskScope) => void,
  ) {
    this.texts = new TaskTexts(session);
    this.results = new DebriefingPanel(this.texts);
    byId("task").addEventListener("change", (event) => this.choose((event.target as HTMLSelectElement).value));
    byId("task-begin").addEventListener("click", () => this.begin());
    byId("task-again").addEventListener("click", () => this.begin());
    byId("task-end").addEventListener("click", () => void requests.once({ type: "task", end: true }));
    byId("task-other").addEventListener("click", () => this.leave());
    volume.drawMarks = (frame, seen) => this.drawMarks(frame, seen);
    effect(() => {
      const run = session.run.value;
      untracked(() => batch(() => this.publish(run)));
    });
    session.onScene((scene) => untracked(() => this.show(scene)));
    session.onState(({ lesson }) => {
      const { task } = lesson;
      const isOffered = this.tasks.some(({ name }) => name === task);
      // the only task that the lesson permits
      if (task !== null && isOffered) untracked(() => task === this.chosen.value || this.choose(task));
    });
    effect(() => this.update());
    session.onFigures(() => this.draw());
  }

  get run(): TaskProgress | null {
    return this.session.run.value;
  }
  get debriefing(): Debriefing | null {
    return this.session.debriefing.value;
  }
  private get tasks(): Task[] {
    return this.session.scene.value?.tasks ?? [];
  }

  /** Begins, ends or restarts a run, by the button that is displayed. */
  beginOrEnd(): void {
    if (byId("training").hidden) return;
    (["task-begin", "task-end", "task-again"] as const)
      .map((id) => byId<HTMLButtonElement>(id))
      .find((button) => !button.hidden && !button.disabled)
      ?.click();
  }

  get task(): Task | null {
    return this.tasks.find(({ name }) => name === this.chosen.value) ?? null;
  }

  private show({ tasks = [] }: Scene): void {
    const offered = JSON.stringify(tasks);
    const isNew = offered !== this.shownTasks;
    this.shownTasks = offered;
    byId("training").hidden = tasks.length === 0;
    byId("task-line").hidden = tasks.length < 2;
    byId<HTMLSelectElement>("task").replaceChildren(
      setMessages(new Option("", ""), { text: "noTask" }),
      ...tasks.map(({ name, title }) => new Option(title, name)),
    );
    if (isNew) {
      this.listed = "";
      // keeps the task of a run that was reported before the scene
      if (!this.task) this.chosen.value = tasks.length === 1 ? tasks[0]!.name : "";
      this.viewedStep.value = -1;
      // a single task is the one that the session was started for
      if (tasks.length === 1) this.viewStep(0, false);
    }
    byId<HTMLSelectElement>("task").value = this.task?.name ?? "";
  }
  /** Takes over a report of a run; null: another connection, whose session may count runs from 1 again. */
  private publish(run: TaskProgress | null): void {
    const { before } = this;
    this.before = run;
    if (!run) return this.reset();
    if (run.phase === "running" && (before?.phase !== "running" || before.run !== run.run)) {
      this.session.debriefing.value = null;
      this.liveRun = run.run;
      // past events of a run already in progress are not announced
      this.announcedEvents = before && !this.isPlayed ? 0 : run.events_before + run.events.length;
      this.warning = { text: "", until_ms: -Infinity };
      if (before && !this.isPlayed)
        announce(words.taskBegun(this.tasks.find(({ name }) => name === run.task)?.title ?? ""));
    }
    if (run.task !== null && run.phase !== "none" && (run.phase !== "over" || this.closedRun.value !== run.run))
      this.chosen.value = run.task;
    this.reportEvents();
  }
  private reset(): void {
    this.results.reset();
    this.scopedRun = this.closedRun.value = this.liveRun = this.announcedEvents = 0;
  }

  private choose(name: string): void {
    batch(() => {
      this.chosen.value = name;
      this.closedRun.value = this.run?.run ?? 0;
      this.viewedStep.value = -1;
    });
    if (this.task) this.viewStep(0);
  }
  private begin(): void {
    if (this.task) void this.requests.once({ type: "task", begin: this.task.name });
  }
  /** Returns from the results to the briefing. */
  private leave(): void {
    this.closedRun.value = this.run?.run ?? 0;
    byId("task-title").focus();
  }

  /** Announces each event once. */
  private reportEvents(): void {
    const { run, task } = this;
    if (!run || !task || run.run !== this.liveRun) return;
    const all = run.events_before + run.events.length;
    const fresh = Math.min(run.events.length, all - this.announcedEvents);
    if (fresh > 0) for (const event of run.events.slice(-fresh)) announce(this.texts.eventText(task, event));
    this.announcedEvents = all;
  }

  // ---- display

  /** Enables the controls that this viewer may use now. */
  private allow(): void {
    const { connection, session } = this;
    const isOthersTurn = session.state.value?.lesson.of_another === true;
    const isAllowed = connection.allows("hand") && !isOthersTurn;
    // whoever leads a lesson needs no control of the device
    const isTipHeldByOther = session.state.value?.pointer_by === "viewer" && !connection.allows("lesson");
    for (const id of ["task-begin", "task-end", "task-again"])
      byId<HTMLButtonElement>(id).disabled = !isAllowed || isTipHeldByOther || this.run?.phase === "keeping";
    const areRunsSaved = connection.allows("own_runs") || this.run?.keeps === true;
    const note = this.isPlayed
      ? words.taskPlayed
      : connection.link.value === "over"
        ? words.lessonOver
        : connection.link.value === "connected" && !connection.allows("hand")
          ? words.taskWatch
          : isOthersTurn
            ? words.lessonOfAnother
            : isTipHeldByOther
              ? words.taskOthers
              : areRunsSaved
                ? words.taskStored
                : words.taskNotStored;
    write(byId("task-note"), note);
  }

  /** Whether the runs are those of a recording that is played. */
  private get isPlayed(): boolean {
    return this.session.scene.value?.recording != null;
  }

  private update(): void {
    const { run, task } = this;
    const before = this.view;
    const isRunning = run !== null && (run.phase === "running" || run.phase === "keeping");
    const isOver =
      this.debriefing !== null &&
      run?.phase === "over" &&
      this.debriefing.run === run.run &&
      this.closedRun.value !== run.run &&
      this.debriefing.task === task?.name;
    // once per run, because the user may have moved the scope since
    const scope = isRunning ? task?.scope : null;
    if (scope && this.scopedRun !== run!.run) {
      this.scopedRun = run!.run;
      untracked(() => this.setScope(scope));
    }
    this.view = !task ? "none" : isRunning ? "running" : isOver ? "debriefing" : "briefing";
    const hadFocus = byId("training").contains(document.activeElement) || this.tookFocus;
    // browsers remove the focus from a button that is disabled, as while the run is stored
    this.tookFocus = run?.phase === "keeping" && hadFocus;
    const isShown =
      this.view === "debriefing" || this.session.state.value?.lesson.names === true || this.connection.allows("lesson");
    const toFind = task?.quiz && !isShown ? task.to_find : null;
    untracked(() => this.hide(toFind));

    const { view } = this;
    byId<HTMLSelectElement>("task").disabled =
      view === "running" || (this.session.state.value?.lesson.task ?? null) !== null;
    byId<HTMLSelectElement>("task").value = task?.name ?? "";
    for (const [ids, where] of [
      [["task-briefing", "task-rules", "task-begin"], ["briefing"]],
      [["task-time", "task-forces", "task-end"], ["running"]],
      [["debriefing", "task-again", "task-other"], ["debriefing"]],
      [
        ["task-title", "task-steps", "task-note"],
        ["briefing", "running", "debriefing"],
      ],
    ])
      for (const id of ids) byId(id).hidden = !where.includes(view);
    // a recording has no controls for runs
    if (this.isPlayed) for (const id of ["task-begin", "task-end", "task-again", "task-other"]) byId(id).hidden = true;
    if (task) this.showTask(task);
    this.showWarning(task && view === "running" ? this.warningOf(task, run!) : []);
    this.allow();
    if (before !== view) {
      // moves the focus, because its button may be hidden now
      if (hadFocus && task && before !== "none")
        byId(view === "running" && !this.isPlayed ? "task-end" : "task-title").focus();
    }
  }

  private showTask(task: Task): void {
    write(byId("task-title"), task.title);
    write(byId("task-briefing"), task.briefing);
    this.listSteps(task);
    this.showSteps(task);
    if (this.view === "running") this.showRun(task, this.run!);
    if (this.view === "debriefing") this.results.show(task, this.debriefing!, this.liveRun);
  }

  private listSteps(task: Task): void {
    const listing = [task.name, this.session.quiz.value !== null, words.now].join();
    if (listing === this.listed) return;
    this.listed = listing;
    byId("task-rules").replaceChildren(...this.texts.rules(task).map((rule) => element("li", {}, rule)));
    byId("task-steps").replaceChildren(
      ...task.steps.map((step, n) => {
        const where = setMessages(
          element("button", { type: "button", className: "where" }),
          { text: "locate", label: "locateStep" },
          step.name,
        );
        where.addEventListener("click", () => this.viewStep(n));
        return element(
          "li",
          {},
          element("span", { className: "mark", ariaHidden: "true" }),
          element(
            "span",
            { className: "step" },
            element("span", { className: "name" }, step.name),
            element("span", { className: "state" }),
            element("span", { className: "quiet" }, this.texts.stepText(step)),
            setMessages(
              element("meter", { min: 0, max: 1, value: 0, hidden: true }),
              { label: "stepProgress" },
              step.name,
            ),
          ),
          where,
        );
      }),
    );
    const bars = task.forces.map((force) => this.barOf(force));
    byId("task-forces").replaceChildren(...bars.map(({ row }) => row));
    this.bars = bars;
  }
  /** Bar of a force with its accepted band and its limit. */
  private barOf({ labels, band_N, limit_N }: TaskForce): {
    reading: HTMLElement;
    bar: HTMLElement;
    value: HTMLElement;
    row: HTMLElement;
  } {
    const top = 1.25 * Math.max(limit_N ?? 0, band_N?.[1] ?? 0, 1.2 * (band_N?.[0] ?? 0), 0.4);
    const percent = (force: number) => Math.min(100, (100 * force) / top);
    const value = element("span", { className: "value" });
    const bar = setMessages(
      element("div", { className: "band" }, value),
      { label: "forceOn" },
      this.texts.namesOf(labels),
    );
    for (const [name, now] of [
      ["role", "meter"],
      ["aria-valuemin", "0"],
      ["aria-valuemax", top.toFixed(2)],
      ["aria-valuenow", "0"],
    ] as const)
      bar.setAttribute(name, now);
    bar.dataset.top = String(top);
    if (band_N) {
      const zone = element("span", { className: "zone" });
      zone.style.left = `${percent(band_N[0])}%`;
      zone.style.right = `${100 - percent(band_N[1] ?? top)}%`;
      bar.prepend(zone);
    }
    if (limit_N !== null) {
      const limit = element("span", { className: "limit" });
      limit.style.left = `${percent(limit_N)}%`;
      bar.append(limit);
    }
    const reading = element("span", { className: "said" });
    return {
      reading,
      bar,
      value,
      row: element(
        "div",
        {},
        element("div", { className: "of" }, element("span", {}, this.texts.namesOf(labels)), reading),
        bar,
      ),
    };
  }

  /** Index of the current step. */
  private currentStep(task: Task): number {
    const { run } = this;
    if (!run || run.task !== task.name) return 0;
    const open = task.steps.map((_, n) => n).filter((n) => !run.done[n]);
    if (task.ordered) return open[0] ?? -1;
    return open.reduce((best, n) => ((run.share[n] ?? 0) > (run.share[best] ?? 0) ? n : best), open[0] ?? -1);
  }
  private showSteps(task: Task): void {
    const { run, view } = this;
    const done = view === "running" && run ? run.done : view === "debriefing" ? this.debriefing!.done : [];
    const current = view === "running" ? this.currentStep(task) : -1;
    [...byId("task-steps").children].forEach((child, n) => {
      const item = child as HTMLElement;
      const state = done[n] ? "done" : n === current ? "current" : "open";
      if (item.dataset.state !== state) {
        item.dataset.state = state;
        if (state === "current") item.setAttribute("aria-current", "step");
        else item.removeAttribute("aria-current");
        write(item.querySelector(".mark")!, done[n] ? "✓" : n === current ? "▶" : "○");
      }
      write(
        item.querySelector(".state")!,
        done[n] ? words.done : n === current ? words.now : view === "debriefing" ? words.notDone : "",
      );
      const meter = item.querySelector("meter")!;
      meter.hidden = state !== "current";
      meter.value = run?.share[n] ?? 0;
    });
    if (view === "running" && current >= 0 && current !== this.viewedStep.peek() && this.viewedStep.peek() >= 0) {
      this.viewedStep.value = current;
      byId("task-steps").children[current]?.scrollIntoView({ block: "nearest" });
    }
  }

  private showRun(task: Task, run: TaskProgress): void {
    const remaining =
      task.time_limit_s === null ? "" : ` · ${words.timeLeft(seconds(Math.max(0, task.time_limit_s - run.time_s)))}`;
    write(
      byId("task-time"),
      run.phase === "keeping" ? words.beingStored : `${words.underWay(seconds(run.time_s))}${remaining}`,
    );
    task.forces.forEach(({ band_N, limit_N }, n) => {
      const { reading, bar, value } = this.bars[n]!;
      const force = run.forces_N[n] ?? 0;
      const where =
        limit_N !== null && force > limit_N
          ? "limit"
          : force < TOUCHED_N
            ? "none"
            : !band_N
              ? "some"
              : force < band_N[0]
                ? "under"
                : band_N[1] !== null && force > band_N[1]
                  ? "over"
                  : "in";
      bar.dataset.where = where;
      bar.setAttribute("aria-valuenow", Math.min(force, Number(bar.dataset.top)).toFixed(2));
      value.style.width = `${Math.min(100, (100 * force) / Number(bar.dataset.top))}%`;
      write(reading, `${quantity(force, "N")} · ${words.inBand[where]}`);
      bar.setAttribute("aria-valuetext", reading.textContent ?? "");
    });
  }
  private warningOf(task: Task, run: TaskProgress): string[] {
    const over = task.forces.flatMap(({ labels, limit_N }, n) =>
      limit_N !== null && (run.forces_N[n] ?? 0) > limit_N
        ? [words.isOver(this.texts.namesOf(labels), quantity(limit_N, "N"))]
        : [],
    );
    const touched = task.protected.flatMap(({ labels, limit_N }, n) =>
      (run.protected_N[n] ?? 0) > limit_N ? [words.isProtected(this.texts.namesOf(labels))] : [],
    );
    return [
      ...over,
      ...touched,
      ...(run.unseen ? [words.isUnseen] : []),
      ...(run.missing_s > 0 ? [words.ticksMissing(seconds(run.missing_s))] : []),
    ];
  }
  private showWarning(warnings: string[]): void {
    const now = performance.now();
    if (warnings.length > 0)
      this.warning = { text: warnings.map((one) => `⚠ ${one}`).join(" "), until_ms: now + WARNING_MS };
    const isShown = this.view === "running" && now < this.warning.until_ms;
    byId("task-warning").hidden = this.view !== "running";
    write(byId("task-warning"), isShown ? this.warning.text : "");
  }

  /** Redraws the plots, whose theme and size may change. */
  private draw(): void {
    if (this.view === "debriefing") this.results.draw();
    if (this.view === "running" && performance.now() > this.warning.until_ms) this.showWarning([]);
  }

  // ---- in the volume

  /**
   * Moves the camera to view the region of a step.
   * @param isAsked  requested by the user, hence undoable
   */
  viewStep(n: number, isAsked = true): void {
    const region = this.task?.regions[this.task.steps[n]?.region ?? -1];
    this.viewedStep.value = n;
    if (region) this.volume.focusOn(region.middle_mm, region.radius_mm, region.outward, isAsked);
  }
  private drawMarks(...[frame, seen]: Parameters<VolumeView["drawMarks"]>): void {
    const { task, view, debriefing } = this;
    if (!task) return;
    if (view !== "debriefing") {
      const step = task.steps[view === "running" ? this.currentStep(task) : this.viewedStep.value];
      const region = step && task.regions[step.region];
      if (region) drawRegion(frame, seen, region, step.name);
      return;
    }
    if (!debriefing) return;
    if (byId<HTMLInputElement>("show-coverage").checked) drawPatches(frame, seen, debriefing);
    if (byId<HTMLInputElement>("show-way").checked) drawPath(frame, seen, debriefing, task.forces);
    if (debriefing.to_find_mm) drawPosition(frame, seen, debriefing.to_find_mm, words.targetWasHere, true);
    if (debriefing.answer_mm) drawPosition(frame, seen, debriefing.answer_mm, words.yourAnswer, false);
  }
}
