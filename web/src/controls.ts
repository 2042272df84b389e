// Everything beside the pictures: tools, settings of the loop, display, figures, plots.

import type { Connection } from "./connection.js";
import { byId, press, toast, write } from "./dom.js";
import { angleOf_deg, length, positionText } from "./geometry.js";
import { touchedText } from "./overlay.js";
import { Plot } from "./plots.js";
import { refusalText, type Requests } from "./requests.js";
import { CT_PRESETS, SIDE_TEXT, type Scene, type State } from "./scene.js";
import { readable, type Session, type Tool } from "./session.js";
import { StructuresPanel } from "./structures_panel.js";
import { nextTheme } from "./theme.js";
import { Flag, type Pose } from "./wire.js";

export interface Actions {
  layout(name: string): void;
  screenshot(): void;
  record(): void;
  clearMeasures(): void;
}

/** What a flag of the tick means for the hand. */
const FLAG_TEXTS: [number, string][] = [
  [Flag.emergencyStop, "emergency stop"], [Flag.paused, "paused"], [Flag.stale, "no pose from the hand"],
  [Flag.deviceFault, "device fault"], [Flag.halted, "halted"], [Flag.jump, "jump"], [Flag.notFinite, "not finite"],
  [Flag.clamped, "at the limit"], [Flag.thermal, "motor warm"], [Flag.clutched, "clutched"], [Flag.wedged, "wedged"],
  [Flag.ruptured, "through the surface"], [Flag.inside, "inside since contact began"], [Flag.passivity, "damped"],
  [Flag.turnHeld, "turn held"],
  [Flag.ramp, "fading"],
];
const MOVER = { script: "simulated hand", pointer: "moved by a viewer's pointer", device: "in a hand" } as const;
const AUTO = "Percentiles of this scan";

export class Controls {
  readonly structures: StructuresPanel;
  private readonly force = new Plot(byId("plot-force"), ["--limit", "--force"], 10, 0.5);
  private readonly late = new Plot(byId("plot-late"), ["--lateness", "--accent"], 60, 10);
  private readonly rate = new Plot(byId("plot-rate"), ["--speed"], 60, 100);
  private wasPointer: boolean | null = null;
  private methodFailure: string | null = null; // that was told last
  private slow_s = -Infinity; // when the slow plots got their last sample

  constructor(private readonly session: Session, private readonly connection: Connection,
              private readonly requests: Requests, private readonly actions: Actions) {
    this.structures = new StructuresPanel(session, requests);
    requests.onRefused = () => session.state && this.showState(session.state);
    this.listen();
    this.setTool("window");
  }

  private get isAllowed(): boolean {
    return this.connection.link === "connected" && this.connection.role === "control";
  }

  private listen(): void {
    const { session, requests, actions } = this;
    byId("theme").addEventListener("click", nextTheme);
    byId("stop").addEventListener("click", () => this.stop());
    byId("rearm").addEventListener("click", () => {
      if (session.state?.stop != null) void requests.once({ type: "rearm", stop: session.state.stop });
    });
    byId("pause").addEventListener("click", () => this.togglePause());
    byId("follow").addEventListener("click", () => this.toggleFollow());
    byId("clear").addEventListener("click", actions.clearMeasures);
    byId("shot").addEventListener("click", actions.screenshot);
    byId("record").addEventListener("click", actions.record);
    byId("unturn").addEventListener("click", () => void requests.once({ type: "set", rotation_wxyz: [1, 0, 0, 0] }));
    for (const button of document.querySelectorAll<HTMLElement>("[data-tool]")) button.addEventListener("click", () => this.chooseTool(button.dataset.tool as Tool));
    for (const button of document.querySelectorAll<HTMLElement>("[data-layout]")) button.addEventListener("click", () => actions.layout(button.dataset.layout!));

    byId<HTMLSelectElement>("method").addEventListener("change", (event) =>
      void requests.once({ type: "set", method: (event.target as HTMLSelectElement).value }));
    for (const name of ["friction", "viscosity", "passivity"] as const) {
      byId<HTMLInputElement>(name).addEventListener("change", (event) =>
        void requests.once({ type: "set", [name]: (event.target as HTMLInputElement).checked }));
    }
    const limit = byId<HTMLInputElement>("limit");
    limit.addEventListener("input", () => {
      write(byId("limit-value"), `${Number(limit.value).toFixed(2)} N`);
      void requests.latest("limit", { type: "set", max_force_N: Number(limit.value) });
    });

    // display
    byId<HTMLSelectElement>("preset").addEventListener("change", (event) => this.usePreset((event.target as HTMLSelectElement).value));
    for (const name of ["level", "width"] as const) {
      byId<HTMLInputElement>(name).addEventListener("change", (event) => {
        const value = Number((event.target as HTMLInputElement).value);
        if (Number.isFinite(value) && (name === "level" || value > 0)) session.window = { ...session.window, [name]: value };
        session.touch();
      });
    }
    const slider = (id: string, set: (value: number) => void) => byId<HTMLInputElement>(id).addEventListener("input", (event) => {
      set(Number((event.target as HTMLInputElement).value));
      session.touch();
    });
    slider("fill", (value) => (session.fill = value));
    slider("scan-in-volume", (value) => {
      session.scanInVolume = value;
      session.fieldVersion += 1;
    });
    byId<HTMLInputElement>("outlines").addEventListener("change", (event) => {
      session.outlines = (event.target as HTMLInputElement).checked;
      session.touch();
    });
    byId<HTMLSelectElement>("convention").addEventListener("change", (event) => {
      session.convention = (event.target as HTMLSelectElement).value as "LPS" | "RAS";
      session.touch();
    });
    window.addEventListener("keydown", (event) => this.key(event), { capture: true });
  }

  /** The space bar stops wherever the focus is, a text field excepted; so switches and buttons are worked with Enter. */
  private key(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    const writes = target.matches("input[type=password], input[type=number], input[type=text]");
    if (event.key === " " && !writes) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) this.stop();
      return;
    }
    if (event.key === "Enter" && target.matches("input[type=checkbox]")) target.click();
    if (writes || target.matches("select") || event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
    const keys: Record<string, () => void> = {
      w: () => this.chooseTool("window"), v: () => this.chooseTool("pan"), r: () => this.chooseTool("ruler"), a: () => this.chooseTool("angle"), t: () => this.chooseTool("touch"),
      "1": () => this.actions.layout("two"), "2": () => this.actions.layout("five"), "3": () => this.actions.layout("volume"), "4": () => this.actions.layout("section"),
      f: () => this.toggleFollow(), s: this.actions.screenshot, o: this.actions.record, d: nextTheme, p: () => this.togglePause(),
    };
    keys[event.key.toLowerCase()]?.();
  }

  /** Whoever has the hand; a physical device is armed where it is. */
  private get mayRearm(): boolean {
    const { scene, state } = this.session;
    return this.isAllowed && state?.stop != null && scene?.device.simulated === true && (scene.device.input !== "pointer" || state.pointer);
  }
  /** What is to be done about a stop, the tip being where it is. */
  private rearmHint(touches: boolean): string {
    const { scene, state } = this.session;
    if (scene?.device.simulated === false) return "armed again where palpate runs: r, with the tip free";
    if (scene?.device.input === "pointer" && !state?.pointer) return "whoever moves the tip rearms";
    if (touches && scene?.device.input === "script") return "the hand leaves what it touches, then Rearm";
    if (touches) return "lead the tip to where it is free, then Rearm";
    return "Rearm brings the force back";
  }
  /** Never anything else: it can be pressed again and again. */
  private stop(): void {
    void this.requests.once({ type: "stop" });
  }
  private togglePause(): void {
    if (this.session.state && this.isAllowed) void this.requests.once({ type: "set", paused: !this.session.state.paused });
  }
  private toggleFollow(): void {
    const { session } = this;
    session.follow = !session.follow;
    session.cross = session.follow ? null : session.pose?.devices[0]?.tip ?? null;
    session.touch();
  }

  /** Whoever takes another tool gives the hand back, if this page has it. */
  private chooseTool(tool: Tool): void {
    if (tool === "touch" && (this.session.scene?.device.input !== "pointer" || !this.isAllowed)) return;
    const has = this.session.state?.pointer === true;
    this.setTool(tool);
    if (has !== (tool === "touch")) void this.requests.once({ type: "pointer", take: tool === "touch" });
  }
  private setTool(tool: Tool): void {
    this.session.tool = tool;
    for (const button of document.querySelectorAll<HTMLElement>("[data-tool]")) button.setAttribute("aria-checked", String(button.dataset.tool === tool));
    this.session.touch();
  }

  private usePreset(name: string): void {
    const { session } = this;
    const scan = session.scene?.volume.scan;
    const preset = CT_PRESETS[name];
    if (preset) session.window = { ...preset };
    else if (name === AUTO && scan) session.window = { level: (scan.window[0] + scan.window[1]) / 2, width: scan.window[1] - scan.window[0] };
    else if (name === "All values" && scan) session.window = { level: (scan.range[0] + scan.range[1]) / 2, width: scan.range[1] - scan.range[0] };
    if (session.scanInVolume > 0) session.fieldVersion += 1;
    session.touch();
  }

  showScene(scene: Scene): void {
    write(byId("side"), SIDE_TEXT[scene.side]);
    byId("side").classList.toggle("warn", scene.side === "unknown");
    write(byId("modality"), { ct: "CT", mr: "MR", unknown: "Modality unknown" }[scene.modality] + (scene.oriented ? "" : " · orientation unknown"));
    write(byId("device"), `${scene.device.name} · ${MOVER[scene.device.input]} · ${scene.tool.name} tool`);
    write(byId("version"), `palpate ${scene.palpate}`);
    byId<HTMLSelectElement>("method").replaceChildren(...scene.methods.map((name) => new Option(readable(name), name)));
    const limit = byId<HTMLInputElement>("limit");
    limit.min = String(scene.limits.least_max_force_N);
    limit.max = String(scene.limits.most_max_force_N);
    const presets = [AUTO, "All values", ...(scene.modality === "ct" ? Object.keys(CT_PRESETS) : [])];
    byId<HTMLSelectElement>("preset").replaceChildren(...presets.map((name) => new Option(name, name)));
    const touch = document.querySelector<HTMLElement>("[data-tool=touch]")!;
    touch.hidden = scene.device.input !== "pointer";
    this.structures.build(scene);
    // the first thing to do with a pointer is to touch
    const isPointer = scene.device.input === "pointer" && scene.role === "control";
    if (isPointer && this.wasPointer !== true) this.setTool("touch");
    else if (!isPointer && this.session.tool === "touch") this.setTool("window");
    this.wasPointer = isPointer;
  }

  showState(state: State): void {
    byId<HTMLSelectElement>("method").value = state.method_awaited ?? state.method;
    const failure = state.method_failed && refusalText(state.method_failed);
    if (failure && failure !== this.methodFailure) toast(failure);
    this.methodFailure = failure;
    for (const name of ["friction", "viscosity", "passivity"] as const) byId<HTMLInputElement>(name).checked = state[name];
    const limit = byId<HTMLInputElement>("limit");
    if (!limit.matches(":active")) {
      limit.value = String(state.max_force_N);
      write(byId("limit-value"), `${state.max_force_N.toFixed(2)} N`);
    }
    press(byId("pause"), state.paused);
    write(byId("pause"), state.paused ? "Go on" : "Pause");
    byId("stop").classList.toggle("stopped", state.emergency_stop);
    write(byId("stop"), state.emergency_stop ? "Stopped" : "Emergency stop");
    write(byId("viewers"), `${state.viewers} ${state.viewers === 1 ? "viewer" : "viewers"}${state.recording ? " · session recorded" : ""}${state.armed ? " · device armed" : ""}`);
    this.structures.show(state, this.isAllowed);
    this.allow();
  }
  /** Enables what this viewer may do now. */
  allow(): void {
    for (const id of ["method", "friction", "viscosity", "passivity", "limit", "pause", "unturn"]) byId<HTMLInputElement>(id).disabled = !this.isAllowed;
    byId<HTMLButtonElement>("rearm").disabled = !this.mayRearm;
    byId<HTMLButtonElement>("stop").disabled = this.connection.link !== "connected";
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

  /** Figures; ten times a second. */
  draw(): void {
    const { session, connection } = this;
    const { pose } = session;
    document.body.classList.toggle("stale", !session.isFresh);
    const age = session.age_ms >= 1e6 ? "" : session.age_ms > 250 ? ` · data ${(session.age_ms / 1000).toFixed(1)} s old` : ` · ${Math.round(session.age_ms)} ms`;
    const trip = Number.isFinite(connection.roundTrip_ms) ? ` · answer ${connection.roundTrip_ms.toFixed(0)} ms` : "";
    const role = connection.role === "view" ? " · view only" : "";
    write(byId("link-text"), { connecting: "Connecting", connected: "Connected", lost: "Connection lost", refused: "Token needed" }[connection.link] +
      (connection.link === "connected" ? role + age + trip : pose ? age : ""));
    byId("link").dataset.link = connection.link === "connected" && !session.isFresh ? "stale" : connection.link;

    if (pose) {
      const device = pose.devices[0]!;
      const force_N = length(device.force);
      write(byId("force"), force_N.toFixed(2));
      write(byId("force-limit"), `of ${device.forceLimit.toFixed(2)} N`);
      byId<HTMLMeterElement>("force-meter").value = Math.min(1, force_N / Math.max(device.forceLimit, 1e-6));
      write(byId("touched"), touchedText(session, device));
      write(byId("stiffness"), device.stiffness > 0 ? `${Number(device.stiffness.toPrecision(3))} N/mm` : "–");
      write(byId("depth"), Number.isFinite(device.depth) ? `${device.depth.toFixed(2).replace("-", "−")} mm` : "–");
      write(byId("speed"), `${device.speed.toFixed(0)} mm/s`);
      write(byId("heat"), Number.isFinite(device.heat) ? `${Math.round(100 * device.heat)} %` : "–");
      const isResting = session.scene?.device.input === "pointer" && device.flags & Flag.stale;
      write(byId("flags"), isResting && !pose.devices.some((d) => d.flags & Flag.emergencyStop) ? "Hold the button in a picture to touch"
        : [...FLAG_TEXTS.filter(([flag]) => device.flags & flag).map(([, words]) => words),
           ...(session.state?.stop != null ? [this.rearmHint((device.flags & (Flag.contact | Flag.inside)) !== 0)] : [])].join(" · "));
      this.structures.touched(device.label);
      const angle = angleOf_deg(pose.rotation);
      write(byId("turned"), angle > 0.05 ? `turned by ${angle.toFixed(0)}°` : "not turned");
      write(byId("loop"), `${pose.rate.toFixed(0)} Hz · late ${pose.lateness.p50.toFixed(0)}/${pose.lateness.p99.toFixed(0)} µs · skip ${pose.skipped} drop ${pose.dropped}`);
      write(byId("plot-force-value"), `${force_N.toFixed(2)} / ${device.forceLimit.toFixed(2)}`);
      write(byId("plot-late-value"), `p50 ${pose.lateness.p50.toFixed(0)}, p99 ${pose.lateness.p99.toFixed(0)}`);
      write(byId("plot-rate-value"), pose.rate.toFixed(0));
    }
    this.force.draw();
    this.late.draw();
    this.rate.draw();
    this.showDisplay();
    this.showReadout();
    press(byId("follow"), session.follow);
  }

  private showDisplay(): void {
    const { session } = this;
    for (const name of ["level", "width"] as const) {
      const input = byId<HTMLInputElement>(name);
      if (document.activeElement !== input) input.value = String(Number(session.window[name].toPrecision(4)));
    }
    byId<HTMLInputElement>("fill").value = String(session.fill);
    write(byId("fill-value"), `${Math.round(100 * session.fill)} %`);
    write(byId("scan-in-volume-value"), `${Math.round(100 * session.scanInVolume)} %`);
  }

  /** Of what is under the mouse, or of the tip. */
  private showReadout(): void {
    const { session } = this;
    const p = session.pointed ?? session.pose?.devices[0]?.tip;
    if (!p || !session.volumes || !session.scene) return;
    write(byId("position"), `${session.pointed ? "" : "tip  "}${positionText(p, session.convention)}`);
    const value = session.volumes.valueAt(p);
    const unit = session.scene.modality === "ct" ? " HU" : "";
    write(byId("value"), value === null ? "" : `${session.scene.modality === "ct" ? "" : "value "}${value.toFixed(0).replace("-", "−")}${unit}`);
    const place = session.volumes.structureAt(p);
    write(byId("structure"), place === null ? "" : readable(session.scene.structures[place]!.name));
  }
}

export const complain = (error: unknown): void => toast((error as Error).message);
