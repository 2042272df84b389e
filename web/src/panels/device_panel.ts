// Operation of the device: emergency stop, pause, motor, rearming, undo of strokes; volumes that a burr has removed.

import { effect, signal } from "@preact/signals-core";
import type { State } from "../protocol/messages.js";
import { byId, press, write } from "../base/dom.js";
import { digits } from "../words/figures.js";
import type { Permissions } from "../state/permissions.js";
import type { Requests } from "../state/requests.js";
import type { Session } from "../state/session.js";
import { setMessages, words } from "../words/words.js";

export class DevicePanel {
  private readonly code = signal(""); // code for arming, as entered so far

  constructor(
    private readonly session: Session,
    private readonly requests: Requests,
    private readonly permissions: Permissions,
  ) {
    byId("stop").addEventListener("click", () => this.stop());
    byId("rearm").addEventListener("click", () => this.rearm());
    const code = byId<HTMLInputElement>("arm-code");
    code.addEventListener("input", () => (this.code.value = code.value));
    code.addEventListener("keydown", (event) => event.key === "Enter" && byId("rearm").click());
    byId("pause").addEventListener("click", () => this.togglePause());
    byId("motor").addEventListener(
      "click",
      () => void requests.once({ type: "set", motor: !session.state.value?.motor }),
    );
    byId("undo-stroke").addEventListener("click", () => void requests.once({ type: "undo" }));
    byId("redo-stroke").addEventListener("click", () => void requests.once({ type: "redo" }));
    byId("unturn").addEventListener("click", () => void requests.once({ type: "set", rotation_wxyz: [1, 0, 0, 0] }));
    effect(() => {
      byId("motor").hidden = byId("strokes").hidden = !session.scene.value?.tools.some(({ cuts }) => cuts);
    });
    session.onState((state) => this.showState(state));
    session.onState((state) => this.showRemoved(state));
    effect(() => this.allow());
  }

  /** Requests an emergency stop; the button never rearms, so that repeated presses are safe. */
  stop(): void {
    void this.requests.once({ type: "stop" });
  }
  togglePause(): void {
    const state = this.session.state.value;
    if (state && this.permissions.operateTool.value) void this.requests.once({ type: "set", paused: !state.paused });
  }
  private rearm(): void {
    const stop = this.session.state.value?.stop;
    if (stop == null) return;
    void this.requests.once({ type: "rearm", stop, ...(this.wantsCode ? { code: this.code.value } : {}) });
    byId<HTMLInputElement>("arm-code").value = this.code.value = "";
  }

  /** Whether arming needs a code: a physical device displays it, or is armed at the device itself. */
  private get wantsCode(): boolean {
    return this.session.scene.value?.device.simulated === false;
  }
  /** Whether this viewer can lift the active stop now. */
  private get mayRearm(): boolean {
    const scene = this.session.scene.value,
      state = this.session.state.value;
    if (!this.permissions.operateTool.value || state?.stop == null || !scene) return false;
    if (this.wantsCode) return /^[0-9]{6}$/.test(this.code.value);
    return scene.device.input !== "pointer" || state.pointer;
  }
  /** Enables the controls that this viewer may use now, also after a refusal. */
  private allow(): void {
    void this.requests.refusals.value;
    const state = this.session.state.value;
    const isAllowed = this.permissions.operateTool.value;
    for (const id of ["motor", "pause", "unturn"]) byId<HTMLButtonElement>(id).disabled = !isAllowed;
    byId<HTMLButtonElement>("rearm").disabled = !this.mayRearm;
    byId("arm-line").hidden = !(this.wantsCode && isAllowed && state?.stop != null);
    for (const [id, count, title] of [
      ["undo-stroke", state?.strokes.undo, "undoStrokeTitle"],
      ["redo-stroke", state?.strokes.redo, "redoStrokeTitle"],
    ] as const) {
      const button = byId<HTMLButtonElement>(id);
      button.disabled = !isAllowed || !count || state!.motor_is_on;
      setMessages(button, { title: isAllowed && state?.motor_is_on ? "motorOffFirst" : title });
    }
  }

  private showState(state: State): void {
    press(byId("motor"), state.motor);
    press(byId("pause"), state.paused);
    setMessages(byId("pause"), { text: state.paused ? "resume" : "pause" });
    byId("stop").classList.toggle("stopped", state.emergency_stop);
    setMessages(byId("stop"), { text: state.emergency_stop ? "stopped" : "stop" });
  }
  /** Shows the removed volumes, those of protected structures apart, and the burr's minimum distances to the others. */
  private showRemoved({ removed, broken_off_mm3: brokenOff, nearest }: State): void {
    const { session } = this;
    const parts = removed.map(({ label, mm3 }) => words.removed(`${digits(mm3)} mm³`, session.nameOf(label)));
    if (brokenOff > 0) parts.push(words.brokenOff(`${digits(brokenOff)} mm³`));
    write(byId("removed"), parts.join(", "));
    const scene = session.scene.value;
    if (!scene) return;
    const isProtected = (label: number): boolean =>
      (scene.tissues[scene.structures.find((structure) => structure.label === label)?.tissue ?? -1]?.protection ??
        "none") !== "none";
    const damage = removed.filter(({ label }) => isProtected(label));
    write(
      byId("damage"),
      damage.map(({ label, mm3 }) => words.protectedGone(`${digits(mm3)} mm³`, session.nameOf(label))).join(", "),
    );
    byId("damage").hidden = damage.length === 0;
    write(
      byId("nearest"),
      nearest
        .filter(({ label }) => !damage.some((gone) => gone.label === label))
        .map(({ label, mm }) => words.nearest(`${digits(mm)} mm`, session.nameOf(label)))
        .join(", "),
    );
  }
}
