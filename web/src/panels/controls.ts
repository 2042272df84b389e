// Controls next to the pictures: tools, loop settings, display, figures and plots.

import type { HeldTool, Scene, State } from "../protocol/messages.js";
import { HAPTIC_SWITCHES } from "../protocol/protocol.gen.js";
import { announce, toast } from "../base/announce.js";
import type { Connection } from "../protocol/connection.js";
import { byId, element, press, write } from "../base/dom.js";
import {
  decimalsFor,
  digits,
  limitQuantity,
  limitText,
  measured,
  quantity,
  stepsText,
  valueText,
} from "../words/figures.js";
import { angleOf_deg, length, positionText } from "../base/geometry.js";
import type { History } from "../state/history.js";
import { keep, recall } from "../state/kept.js";
import { onLanguage } from "../words/language.js";
import { Plot } from "./plots.js";
import { refusalText, type Requests } from "../state/requests.js";
import { CT_PRESETS } from "../protocol/scene.js";
import {
  readable,
  PAGE_KEY,
  type KeptPage,
  type Layout,
  type Session,
  type Slab,
  type Tool,
  type Window,
} from "../state/session.js";
import { StructuresPanel } from "./structures_panel.js";
import { nextTheme } from "./theme.js";
import { whyText } from "./why.js";
import { type DevicePose, type Contact, type Felt, Flag, type Pose } from "../protocol/wire.js";
import { capitalized, says, words, type Words } from "../words/words.js";

export interface Actions {
  layout(name: Layout): void;
  screenshot(): void;
  record(): void;
  togglePlaying(): void;
  beginOrEnd(): void;
  toggleSound(): void;
}

/** Flags of a tick, in display order. */
const FLAGS: (keyof Words["flags"])[] = [
  "emergencyStop",
  "paused",
  "stale",
  "deviceFault",
  "halted",
  "jump",
  "notFinite",
  "noGo",
  "clamped",
  "thermal",
  "clutched",
  "wedged",
  "ruptured",
  "inside",
  "passivity",
  "turnHeld",
  "release",
  "ramp",
];
type Preset = keyof Words["presets"];
const LETTERS_KEY = "palpate.letters";

export class Controls {
  readonly structures: StructuresPanel;
  private readonly force = new Plot(byId("plot-force"), ["--limit", "--force"], 10, 0.5);
  private readonly late = new Plot(byId("plot-late"), ["--lateness", "--accent"], 60, 10);
  private readonly rate = new Plot(byId("plot-rate"), ["--speed"], 60, 100);
  private told = { link: "", happening: "" };
  private window: Window | null = null; // window displayed by the controls
  private wasPointer: boolean | null = null;
  private methodFailure: string | null = null; // error of a method, as reported last
  private lawFailure: string | null = null; // error of a law, as reported last
  private slow_s = -Infinity; // time of the latest sample in the slow plots

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
    private readonly requests: Requests,
    private readonly history: History,
    private readonly actions: Actions,
  ) {
    this.structures = new StructuresPanel(session, requests, history);
    requests.onRefused = () => session.state && this.showState(session.state);
    this.listen();
    this.tellGestures();
    this.setTool("window");
  }

  private get isAllowed(): boolean {
    return (
      this.connection.allows("hand") && !this.session.scene?.recording && this.session.state?.lesson.of_another !== true
    );
  }
  private get mayChangeFeel(): boolean {
    return this.connection.allows("feel") && !this.session.scene?.recording;
  }

  private listen(): void {
    const { session, requests, history, actions } = this;
    onLanguage(() => this.speak());
    byId("theme").addEventListener("click", nextTheme);
    byId("stop").addEventListener("click", () => this.stop());
    byId("rearm").addEventListener("click", () => {
      if (session.state?.stop == null) return;
      const code = byId<HTMLInputElement>("arm-code");
      void requests.once({ type: "rearm", stop: session.state.stop, ...(this.wantsCode ? { code: code.value } : {}) });
      code.value = "";
      this.allow();
    });
    byId("arm-code").addEventListener("input", () => this.allow());
    byId("arm-code").addEventListener("keydown", (event) => {
      if ((event as KeyboardEvent).key === "Enter") byId("rearm").click();
    });
    byId("pause").addEventListener("click", () => this.togglePause());
    byId("motor").addEventListener("click", () => void requests.once({ type: "set", motor: !session.state?.motor }));
    byId("undo-stroke").addEventListener("click", () => void requests.once({ type: "undo" }));
    byId("redo-stroke").addEventListener("click", () => void requests.once({ type: "redo" }));
    byId("follow").addEventListener("click", () => this.toggleFollow());
    byId("undo").addEventListener("click", () => void history.undo());
    byId("redo").addEventListener("click", () => void history.redo());
    history.onChange = () => {
      byId<HTMLButtonElement>("undo").disabled = !history.canUndo;
      byId<HTMLButtonElement>("redo").disabled = !history.canRedo;
    };
    history.onChange();
    // the release of a slider ends an undo step
    document.addEventListener("change", () => (history.gesture += 1));
    byId("shot").addEventListener("click", actions.screenshot);
    byId("record").addEventListener("click", actions.record);
    byId("unturn").addEventListener("click", () => void requests.once({ type: "set", rotation_wxyz: [1, 0, 0, 0] }));
    for (const button of document.querySelectorAll<HTMLElement>("[data-tool]"))
      button.addEventListener("click", () => this.chooseTool(button.dataset.tool as Tool));
    for (const button of document.querySelectorAll<HTMLElement>("[data-layout]"))
      button.addEventListener("click", () => actions.layout(button.dataset.layout as Layout));

    byId<HTMLSelectElement>("method").addEventListener(
      "change",
      (event) => void requests.once({ type: "set", method: (event.target as HTMLSelectElement).value }),
    );
    byId<HTMLSelectElement>("law").addEventListener(
      "change",
      (event) => void requests.once({ type: "set", law: (event.target as HTMLSelectElement).value }),
    );
    for (const name of HAPTIC_SWITCHES) {
      const box = element("input", { id: name, type: "checkbox" });
      box.addEventListener("change", () => void requests.once({ type: "set", [name]: box.checked }));
      byId("feel-switches").append(element("label", {}, box, " ", element("span")));
    }
    this.nameSwitches();
    const limit = byId<HTMLInputElement>("limit");
    limit.addEventListener("input", () => {
      write(byId("limit-value"), quantity(Number(limit.value), "N"));
      void requests.latest("limit", { type: "set", max_force_N: Number(limit.value) });
    });

    // stored state of the panel's cards: open or closed
    const { cards = {} } = recall<KeptPage>(PAGE_KEY);
    for (const card of document.querySelectorAll<HTMLDetailsElement>("details.card")) {
      const name = card.querySelector("summary")!.dataset.words!;
      card.open = cards[name] ?? card.open;
      card.addEventListener("toggle", () =>
        keep<KeptPage>(PAGE_KEY, { cards: { ...recall<KeptPage>(PAGE_KEY).cards, [name]: card.open } }),
      );
    }

    // display
    byId<HTMLSelectElement>("preset").addEventListener("change", (event) =>
      this.usePreset((event.target as HTMLSelectElement).value as Preset),
    );
    for (const name of ["level", "width"] as const) {
      byId<HTMLInputElement>(name).addEventListener("change", (event) => {
        const value = Number((event.target as HTMLInputElement).value);
        if (Number.isFinite(value) && (name === "level" || value > 0))
          history.change("window", () => (session.window = { ...session.window, [name]: value }));
        session.touch();
      });
    }
    const slider = (id: string, set: (value: number) => void) =>
      byId<HTMLInputElement>(id).addEventListener("input", (event) => {
        set(Number((event.target as HTMLInputElement).value));
        session.touch();
      });
    slider("fill", (value) => (session.fill = value));
    slider("scan-in-volume", (value) => (session.scanInVolume = value));
    byId<HTMLInputElement>("outlines").addEventListener("change", (event) => {
      session.outlines = (event.target as HTMLInputElement).checked;
      session.touch();
    });
    byId<HTMLInputElement>("strain").addEventListener("change", (event) => {
      session.strain = (event.target as HTMLInputElement).checked;
      session.touch();
    });
    const slab = () => {
      session.slab = {
        kind: byId<HTMLSelectElement>("slab").value as Slab["kind"],
        mm: Number(byId<HTMLInputElement>("slab-mm").value),
      };
      session.touch();
    };
    byId("slab").addEventListener("change", slab);
    byId("slab-mm").addEventListener("input", slab);
    byId<HTMLSelectElement>("convention").addEventListener("change", (event) => {
      session.convention = (event.target as HTMLSelectElement).value as "LPS" | "RAS";
      session.touch();
    });
    byId("reload").addEventListener("click", () => location.reload());
    byId("help").addEventListener("click", () => this.help(byId("help-box").hidden));
    // single-key shortcuts can be disabled, for speech input; the emergency stop stays enabled
    const letters = byId<HTMLInputElement>("letters");
    letters.checked = localStorage.getItem(LETTERS_KEY) !== "off";
    letters.addEventListener("change", () => localStorage.setItem(LETTERS_KEY, letters.checked ? "on" : "off"));
    byId("help-close").addEventListener("click", () => this.help(false));
    window.addEventListener("keydown", (event) => this.key(event), { capture: true });
  }

  /**
   * Handles a key. The space bar is the emergency stop for every focus except text fields, so that switches and buttons
   * are operated with Enter. Number fields are no text fields, because numbers contain no spaces.
   */
  private key(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    const hasSpaces = target.matches("input[type=password], input[type=text]:not(#arm-code), input[type=search]");
    const writes = hasSpaces || target.matches("input[type=number], #arm-code");
    if ((event.key === " " || event.code === "Space") && !hasSpaces) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) this.stop();
      return;
    }
    if (event.key === "Enter" && target.matches("input[type=checkbox]")) target.click();
    if (event.key === "Escape") this.help(false);
    const isUndo = (event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "z";
    if (isUndo && !writes) {
      event.preventDefault();
      void (event.shiftKey ? this.history.redo() : this.history.undo());
      return;
    }
    if (
      writes ||
      target.matches("select") ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      document.querySelector("dialog[open]")
    )
      return;
    const keys: Record<string, () => void> = {
      w: () => this.chooseTool("window"),
      v: () => this.chooseTool("pan"),
      r: () => this.chooseTool("ruler"),
      a: () => this.chooseTool("angle"),
      e: () => this.chooseTool("plan"),
      t: () => this.chooseTool("touch"),
      "1": () => this.actions.layout("two"),
      "2": () => this.actions.layout("five"),
      "3": () => this.actions.layout("volume"),
      "4": () => this.actions.layout("section"),
      "5": () => this.actions.layout("inside"),
      "6": () => this.actions.layout("scope"),
      "?": () => this.help(byId("help-box").hidden),
      f: () => this.toggleFollow(),
      s: this.actions.screenshot,
      o: this.actions.record,
      d: nextTheme,
      p: () => this.togglePause(),
      b: () => event.repeat || this.actions.beginOrEnd(),
      n: () => event.repeat || this.actions.toggleSound(),
      // one stroke per key press, without repeats
      u: () => event.repeat || byId(event.shiftKey ? "redo-stroke" : "undo-stroke").click(),
    };
    if (byId<HTMLInputElement>("letters").checked) keys[event.key.toLowerCase()]?.();
  }

  /** Opens or closes the help, which is not modal, so that the emergency stop stays within reach of the mouse. */
  private help(isShown: boolean): void {
    const box = byId("help-box");
    if (box.hidden !== isShown) return;
    box.hidden = !isShown;
    byId("help").setAttribute("aria-expanded", String(isShown));
    if (isShown) box.focus();
    else if (box.contains(document.activeElement) || document.activeElement === document.body) byId("help").focus();
  }

  /** Whether arming needs a code: a physical device displays it, or is armed at the device itself. */
  private get wantsCode(): boolean {
    return this.session.scene?.device.simulated === false;
  }
  /** Whether this viewer can lift the active stop now. */
  private get mayRearm(): boolean {
    const { scene, state } = this.session;
    if (!this.isAllowed || state?.stop == null || !scene) return false;
    if (this.wantsCode) return /^[0-9]{6}$/.test(byId<HTMLInputElement>("arm-code").value);
    return scene.device.input !== "pointer" || state.pointer;
  }
  /** Instruction to lift a stop, given whether the tip is in contact. */
  private rearmHint(touches: boolean): string {
    const { scene, state } = this.session;
    if (scene?.device.simulated === false) return words.rearmThere;
    if (scene?.device.input === "pointer" && !state?.pointer) return words.rearmOther;
    if (touches && scene?.device.input === "script") return words.rearmWhenFree;
    if (touches) return words.rearmAfterWay;
    return words.rearmNow;
  }
  /** Texts of conditions that withhold or change the force, with the source of a stop and the remedy. */
  private happening(device: DevicePose): string[] {
    const { scene, state } = this.session;
    // a pointer without input is idle, which is no fault
    const isResting = scene?.device.input === "pointer" && (device.flags & Flag.stale) !== 0;
    const flags = FLAGS.filter(
      (name) => device.flags & Flag[name] && !(isResting && (name === "stale" || name === "ramp")),
    );
    const { pushing } = this.session;
    const told = flags.map((name) => {
      if (name === "emergencyStop" && state?.stopped_by) return words.stoppedBy[state.stopped_by];
      return name === "noGo" && pushing
        ? words.keptAwayFrom(this.session.regionName(pushing.region))
        : words.flags[name];
    });
    if (state?.stop != null)
      return [...told, this.rearmHint((device.flags & (Flag.contact | Flag.inside | Flag.noGo)) !== 0)];
    if (isResting)
      told.push(state?.pointer ? words.holdToTouch : state?.pointer_by ? words.otherHolds : words.nobodyHolds);
    return told;
  }
  /** Requests an emergency stop; the button never rearms, so that repeated presses are safe. */
  private stop(): void {
    void this.requests.once({ type: "stop" });
  }
  private togglePause(): void {
    if (this.session.scene?.recording) this.actions.togglePlaying();
    else if (this.session.state && this.isAllowed)
      void this.requests.once({ type: "set", paused: !this.session.state.paused });
  }
  private toggleFollow(): void {
    const { session } = this;
    const follow = !session.follow;
    this.history.change(
      "follow",
      () =>
        (session.planes = {
          follow,
          cross: follow ? null : (session.pose?.devices[0]?.tip ?? null),
          obliqueNormal: null,
        }),
    );
  }

  /** Chooses a tool; the pointer is taken or released with it. */
  private chooseTool(tool: Tool): void {
    if (tool === "touch" && (this.session.scene?.device.input !== "pointer" || !this.isAllowed)) return;
    const has = this.session.state?.pointer === true;
    this.setTool(tool);
    if (has !== (tool === "touch")) void this.requests.once({ type: "pointer", take: tool === "touch" });
  }
  private setTool(tool: Tool): void {
    this.session.tool = tool;
    for (const button of document.querySelectorAll<HTMLElement>("[data-tool]"))
      button.setAttribute("aria-checked", String(button.dataset.tool === tool));
    this.session.touch();
  }

  private usePreset(name: Preset): void {
    const { session } = this;
    const scan = session.scene?.volume.scan;
    const between = ([low, high]: [number, number]) => ({ level: (low + high) / 2, width: high - low });
    this.history.change("window", () => {
      if (name !== "percentiles" && name !== "all") session.window = { ...CT_PRESETS[name] };
      else if (scan) session.window = between(name === "all" ? scan.range : scan.window);
    });
    session.touch();
  }

  /** Rewrites texts without continuous updates, after a change of the language. */
  private speak(): void {
    const { scene, state } = this.session;
    if (scene) this.nameScene(scene);
    this.structures.offerPresets();
    this.nameSwitches();
    if (state) this.showState(state);
    this.tellGestures();
    this.session.touch();
  }
  private nameSwitches(): void {
    for (const name of HAPTIC_SWITCHES)
      write(byId(name).nextElementSibling as HTMLElement, capitalized(words.recorded[name]));
  }
  private tellGestures(): void {
    byId("gestures").replaceChildren(
      ...words.gestures.map(([how, what]) =>
        element("tr", {}, element("th", { scope: "row" }, ...withKeys(how)), element("td", {}, ...withKeys(what))),
      ),
    );
  }
  private nameScene(scene: Scene): void {
    byId("law-line").hidden = scene.laws.length === 0;
    byId<HTMLSelectElement>("law").replaceChildren(
      ...scene.laws.map((name) => new Option(words.laws[name] ?? name, name)),
    );
    document.title = words.title(words.sideInTitle[scene.side]);
    write(byId("side"), words.side[scene.side]);
    write(byId("modality"), words.modality[scene.modality] + (scene.oriented ? "" : ` · ${words.orientationUnknown}`));
    write(
      byId("device"),
      [scene.device.name, words.mover[scene.device.input], ...new Set(scene.tools.map(toolText))].join(" · "),
    );
    write(byId("scan-steps"), scene.volume.scan ? stepsText(scene.volume.scan.scale) : "");
    const presets: Preset[] = [
      "percentiles",
      "all",
      ...(scene.modality === "ct" ? (Object.keys(CT_PRESETS) as Preset[]) : []),
    ];
    offer("preset", presets, words.presets);
    offer("slab", ["none", "mean", "maximum", "minimum"], words.slabs);
  }

  showScene(scene: Scene): void {
    this.nameScene(scene);
    byId("side").classList.toggle("warn", scene.side === "unknown");
    byId("motor").hidden = byId("strokes").hidden = !scene.tools.some(({ cuts }) => cuts);
    write(byId("version"), `palpate ${scene.palpate}`);
    byId<HTMLSelectElement>("method").replaceChildren(...scene.methods.map((name) => new Option(readable(name), name)));
    const limit = byId<HTMLInputElement>("limit");
    limit.min = String(scene.limits.min_max_force_N);
    limit.max = String(scene.limits.max_max_force_N);
    const touch = document.querySelector<HTMLElement>("[data-tool=touch]")!;
    touch.hidden = scene.device.input !== "pointer";
    this.structures.build(scene);
    // default tool for a pointer: touching
    const isPointer = scene.device.input === "pointer" && scene.may.includes("hand");
    if (isPointer && this.wasPointer !== true) this.setTool("touch");
    else if (!isPointer && this.session.tool === "touch") this.setTool("window");
    this.wasPointer = isPointer;
  }

  private nameOf(label: number): string {
    return readable(this.session.structureName(label) ?? words.unnamed(String(label)));
  }
  /** Shows the volumes removed from protected structures, and the burr's minimum distances to the others. */
  private showProtected({ removed, nearest }: State): void {
    const { scene } = this.session;
    if (!scene) return;
    const isProtected = (label: number): boolean =>
      (scene.tissues[scene.structures.find((structure) => structure.label === label)?.tissue ?? -1]?.protection ??
        "none") !== "none";
    const damage = removed.filter(({ label }) => isProtected(label));
    write(
      byId("damage"),
      damage.map(({ label, mm3 }) => words.protectedGone(`${digits(mm3)} mm³`, this.nameOf(label))).join(", "),
    );
    byId("damage").hidden = damage.length === 0;
    write(
      byId("nearest"),
      nearest
        .filter(({ label }) => !damage.some((gone) => gone.label === label))
        .map(({ label, mm }) => words.nearest(`${digits(mm)} mm`, this.nameOf(label)))
        .join(", "),
    );
  }

  showState(state: State): void {
    byId<HTMLSelectElement>("method").value = state.method_awaited ?? state.method;
    byId<HTMLSelectElement>("law").value = state.law_awaited ?? state.law;
    const nameOfLaw = (law: string) => words.laws[law] ?? law;
    write(
      byId("law-awaited"),
      state.law_awaited ? words.lawAwaited(nameOfLaw(state.law_awaited), nameOfLaw(state.law)) : "",
    );
    byId("law-awaited").hidden = !state.law_awaited;
    write(
      byId("method-awaited"),
      state.method_awaited ? words.methodAwaited(readable(state.method_awaited), readable(state.method)) : "",
    );
    byId("method-awaited").hidden = !state.method_awaited;
    const failure = state.method_failed && refusalText(state.method_failed);
    if (failure && failure !== this.methodFailure) toast(failure);
    this.methodFailure = failure;
    const lawFailure = state.law_failed && refusalText(state.law_failed);
    if (lawFailure && lawFailure !== this.lawFailure) toast(lawFailure);
    this.lawFailure = lawFailure;
    for (const name of HAPTIC_SWITCHES) byId<HTMLInputElement>(name).checked = state[name];
    const limit = byId<HTMLInputElement>("limit");
    if (!limit.matches(":active")) {
      limit.value = String(state.max_force_N);
      write(byId("limit-value"), quantity(state.max_force_N, "N"));
    }
    press(byId("motor"), state.motor);
    write(
      byId("removed"),
      state.removed.map(({ label, mm3 }) => words.removed(`${digits(mm3)} mm³`, this.nameOf(label))).join(", "),
    );
    this.showProtected(state);
    press(byId("pause"), state.paused);
    says(byId("pause"), { text: state.paused ? "goOn" : "pause" });
    byId("stop").classList.toggle("stopped", state.emergency_stop);
    says(byId("stop"), { text: state.emergency_stop ? "stopped" : "stop" });
    write(
      byId("viewers"),
      [
        state.viewers === 1 ? words.viewer : words.viewers(String(state.viewers)),
        ...(state.pointer_by === null ? [] : [state.pointer ? words.youHold : words.viewerHolds]),
        ...(state.recording ? [words.sessionRecorded] : []),
        ...(state.armed ? [words.deviceArmed] : []),
      ].join(" · "),
    );
    this.structures.show(state, this.mayChangeFeel);
    this.allow();
  }
  /** Enables the controls that this viewer may use now. */
  allow(): void {
    for (const id of ["motor", "pause", "unturn"]) byId<HTMLInputElement>(id).disabled = !this.isAllowed;
    for (const id of ["method", "law", ...HAPTIC_SWITCHES, "limit"])
      byId<HTMLInputElement>(id).disabled = !this.mayChangeFeel;
    // hidden from learners in control, whose tasks determine the settings
    byId("feel-settings").hidden = this.connection.allows("hand") && !this.connection.allows("feel");
    byId<HTMLButtonElement>("rearm").disabled = !this.mayRearm;
    byId("arm-line").hidden = !(this.wantsCode && this.isAllowed && this.session.state?.stop != null);
    const { state } = this.session;
    for (const [id, count, title] of [
      ["undo-stroke", state?.strokes.undo, "undoStrokeTitle"],
      ["redo-stroke", state?.strokes.redo, "redoStrokeTitle"],
    ] as const) {
      const button = byId<HTMLButtonElement>(id);
      button.disabled = !this.isAllowed || !count || state!.motor_is_on;
      says(button, { title: this.isAllowed && state?.motor_is_on ? "motorOffFirst" : title });
    }
  }

  addPose(pose: Pose): void {
    const device = pose.devices[0]!;
    this.force.push(pose.time, [device.forceLimit, length(device.force)]);
    if (pose.time >= this.slow_s + 0.2 || pose.time < this.slow_s) {
      this.slow_s = pose.time;
      this.late.push(pose.time, [pose.lateness.p99, pose.lateness.p50]);
      this.rate.push(pose.time, [pose.rate]);
    }
  }

  /** Draws the structures along the penetration path, outermost first: path length in each and share of the force. */
  private drawFelt(felt: Felt[]): void {
    const rows = byId<HTMLTableElement>("felt").tBodies[0]!;
    while (rows.rows.length < felt.length)
      rows.append(element("tr", {}, element("th", { scope: "row" }), element("td"), element("td")));
    for (const [n, row] of [...rows.rows].entries()) {
      const part = felt[n];
      row.hidden = part === undefined;
      if (part === undefined) continue;
      const [name, depth, share] = row.cells;
      write(name!, this.nameOf(part.label));
      write(depth!, Number.isFinite(part.depth) ? quantity(part.depth, "mm") : words.deep);
      write(share!, `${Math.round(100 * part.share)} %`);
    }
  }

  /** Draws the structures in contact with parts of the tool, if there are several contacts. */
  private drawContacts(contacts: Contact[]): void {
    const leans = byId("leans");
    const text =
      contacts.length > 1
        ? words.leansOn(contacts.map(({ label, force }) => `${this.nameOf(label)} ${quantity(force, "N")}`).join(", "))
        : "";
    write(leans, text);
    leans.title = text;
  }

  /**
   * Announces changes of the connection and of conditions that withhold the force, but no continuously changing
   * figures.
   */
  private tell(happening: string): void {
    const { connection, session } = this;
    const told = {
      link:
        words.link[connection.link] +
        (connection.link === "connected" && !session.isFresh ? ` · ${words.oldPoses}` : ""),
      happening,
    };
    for (const part of ["link", "happening"] as const) if (told[part] !== this.told[part]) announce(told[part]);
    this.told = told;
  }

  /** Updates the figures; to be called ten times a second. */
  draw(): void {
    const { session, connection } = this;
    const { pose } = session;
    document.body.classList.toggle("stale", !session.isFresh);
    const age =
      session.age_ms >= 1e6
        ? ""
        : session.age_ms > 250
          ? ` · ${words.dataAge(`${(session.age_ms / 1000).toFixed(1)} s`)}`
          : ` · ${Math.round(session.age_ms)} ms`;
    const trip = Number.isFinite(connection.roundTrip_ms)
      ? ` · ${words.answerTook(`${connection.roundTrip_ms.toFixed(0)} ms`)}`
      : "";
    const role = connection.allows("hand") ? "" : ` · ${words.viewOnly}`;
    write(
      byId("link-text"),
      words.link[connection.link] + (connection.link === "connected" ? role + age + trip : pose ? age : ""),
    );
    byId("link").dataset.link = connection.link === "connected" && !session.isFresh ? "stale" : connection.link;

    if (pose) {
      const device = pose.devices[0]!;
      const contact = session.contactOf(device);
      const force_N = length(device.force);
      const set_N = session.state?.max_force_N ?? device.forceLimit;
      const [force, unit] = measured(force_N, "N");
      write(byId("force"), force);
      write(byId("force-unit"), unit);
      write(byId("force-limit"), limitText(device.forceLimit, set_N));
      byId<HTMLMeterElement>("force-meter").value = Math.min(1, force_N / Math.max(device.forceLimit, 1e-6));
      write(byId("touched"), contact.words);
      write(byId("stiffness"), contact.label > 0 && device.stiffness > 0 ? quantity(device.stiffness, "N/mm") : "–");
      write(byId("depth"), Number.isFinite(device.depth) ? quantity(device.depth, "mm") : "–");
      write(byId("speed"), quantity(device.speed, "mm/s"));
      this.drawFelt(contact.label > 0 ? device.felt : []);
      this.drawContacts(contact.label > 0 ? device.contacts : []);
      write(byId("heat"), Number.isFinite(device.heat) ? `${Math.round(100 * device.heat)} %` : "–");
      write(byId("why"), contact.label > 0 ? whyText(device, session.toPatient(pose, device.force)) : "");
      const happening = this.happening(device).join(" · ");
      write(byId("flags"), happening);
      this.tell(happening);
      this.structures.touched(contact.label);
      const angle = angleOf_deg(pose.rotation);
      write(byId("turned"), angle > 0.05 ? words.turnedBy(`${angle.toFixed(0)}°`) : words.notTurned);
      write(
        byId("loop"),
        words.loop(
          pose.rate.toFixed(0),
          pose.lateness.p50.toFixed(0),
          pose.lateness.p99.toFixed(0),
          String(pose.skipped),
          String(pose.dropped),
        ),
      );
      write(byId("plot-force-value"), words.figureOf(quantity(force_N, "N"), limitQuantity(device.forceLimit, set_N)));
      write(byId("plot-late-value"), words.lateness(pose.lateness.p50.toFixed(0), pose.lateness.p99.toFixed(0)));
      write(byId("plot-rate-value"), pose.rate.toFixed(0));
    }
    this.force.draw();
    this.late.draw();
    this.rate.draw();
    this.showDisplay();
    press(byId("follow"), session.follow);
  }

  private showDisplay(): void {
    const { session } = this;
    if (session.window !== this.window) {
      if (this.window !== null && session.window !== session.givenWindow) session.keepWindow();
      this.window = session.window;
    }
    for (const name of ["level", "width"] as const) {
      const input = byId<HTMLInputElement>(name);
      if (document.activeElement !== input) input.value = String(Number(session.window[name].toPrecision(5)));
    }
    byId<HTMLInputElement>("fill").value = String(session.fill);
    write(byId("fill-value"), `${Math.round(100 * session.fill)} %`);
    byId<HTMLSelectElement>("slab").value = session.slab.kind;
    byId<HTMLInputElement>("slab-mm").value = String(session.slab.mm);
    byId<HTMLInputElement>("slab-mm").disabled = session.slab.kind === "none";
    write(byId("slab-mm-value"), quantity(session.slab.mm, "mm"));
    write(byId("scan-in-volume-value"), `${Math.round(100 * session.scanInVolume)} %`);
  }

  /**
   * Updates the readout of the position under the mouse, else of the tip. To be called for every frame, because planes
   * may move under a resting mouse.
   */
  showReadout(): void {
    const { session } = this;
    const pointed = session.pointed?.() ?? null;
    const p = pointed ?? session.pose?.devices[0]?.tip;
    if (!p || !session.volumes || !session.scene) return;
    const decimals = decimalsFor(session.volumes.voxelSize / session.volumes.shrink);
    const position = positionText(p, session.convention, decimals);
    write(byId("position"), pointed ? position : `${words.atTip}  ${position}`);
    const value = session.volumes.valueAt(p);
    const { scan } = session.scene.volume;
    const figure = value === null || !scan ? null : valueText(value, scan.scale);
    write(byId("value"), figure === null ? "" : session.scene.modality === "ct" ? `${figure} HU` : words.value(figure));
    const place = session.volumes.structureAt(p);
    const device = session.pose?.devices[0];
    if (!pointed && device) write(byId("structure"), session.contactOf(device).words);
    else write(byId("structure"), place === null ? "" : readable(session.nameAt(place)));
  }
}

export const complain = (error: unknown): void => toast((error as Error).message);

/** Nodes of a text in which keys stand between backticks. */
const withKeys = (text: string): (Node | string)[] =>
  text.split("`").map((part, n) => (n % 2 === 1 ? element("kbd", {}, part) : part));

/** Name of a tool, and the form of its burr or shaver. */
const toolText = ({ name, burr, shaver }: HeldTool): string =>
  words.toolNamed(name) + (burr ? ` · ${(shaver ? words.shaver : words.burr)[burr as keyof Words["burr"]]}` : "");

/** Replaces the options of a select element, keeping the selection. */
function offer<Name extends string>(id: string, names: Name[], said: Record<Name, string>): void {
  const select = byId<HTMLSelectElement>(id);
  const chosen = select.value;
  select.replaceChildren(...names.map((name) => new Option(said[name], name, false, name === chosen)));
}
