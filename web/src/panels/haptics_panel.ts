// Settings of the loop: haptic method and law, force limit, switches.

import { effect, untracked } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import type { Scene, State } from "../protocol/messages.js";
import { HAPTIC_SWITCHES } from "../protocol/protocol.gen.js";
import type { Connection } from "../protocol/connection.js";
import { byId, element, write } from "../base/dom.js";
import { quantity } from "../words/figures.js";
import type { Permissions } from "../state/permissions.js";
import { refusalText, type Requests } from "../state/requests.js";
import { readable, type Session } from "../state/session.js";
import { capitalized, words } from "../words/words.js";

const nameOfLaw = (law: string): string => words.laws[law] ?? law;

export class HapticsPanel {
  private readonly method = byId<HTMLSelectElement>("method");
  private readonly law = byId<HTMLSelectElement>("law");
  private readonly limit = byId<HTMLInputElement>("limit");
  private failures: Record<"method" | "law", string | null> = { method: null, law: null }; // as reported last

  constructor(session: Session, connection: Connection, requests: Requests, permissions: Permissions) {
    const { method, law, limit } = this;
    method.addEventListener("change", () => void requests.once({ type: "set", method: method.value }));
    law.addEventListener("change", () => void requests.once({ type: "set", law: law.value }));
    for (const name of HAPTIC_SWITCHES) {
      const box = element("input", { id: name, type: "checkbox" });
      box.addEventListener("change", () => void requests.once({ type: "set", [name]: box.checked }));
      const label = element("span");
      effect(() => write(label, capitalized(words.recorded[name])));
      byId("feel-switches").append(element("label", {}, box, " ", label));
    }
    limit.addEventListener("input", () => {
      write(byId("limit-value"), quantity(Number(limit.value), "N"));
      void requests.latest("limit", { type: "set", max_force_N: Number(limit.value) });
    });
    session.onScene((scene) => this.showScene(scene));
    session.onState((state) => {
      // resets the controls after a refusal, too, and when a scene has replaced their options
      void [requests.refusals.value, session.scene.value];
      this.showState(state);
    });
    effect(() => {
      for (const id of ["method", "law", "limit", ...HAPTIC_SWITCHES])
        byId<HTMLInputElement>(id).disabled = !permissions.changeContact.value;
      // hidden from learners in control, whose tasks determine the settings
      byId("feel-settings").hidden = connection.allows("hand") && !connection.allows("feel");
    });
  }

  private showScene({ laws, methods, limits }: Scene): void {
    byId("law-line").hidden = laws.length === 0;
    this.law.replaceChildren(...laws.map((name) => new Option(nameOfLaw(name), name)));
    this.method.replaceChildren(...methods.map((name) => new Option(readable(name), name)));
    this.limit.min = String(limits.min_max_force_N);
    this.limit.max = String(limits.max_max_force_N);
  }

  private showState(state: State): void {
    this.method.value = state.method_awaited ?? state.method;
    this.law.value = state.law_awaited ?? state.law;
    this.showAwaited(
      "method",
      state.method_awaited && words.methodAwaited(readable(state.method_awaited), readable(state.method)),
    );
    this.showAwaited("law", state.law_awaited && words.lawAwaited(nameOfLaw(state.law_awaited), nameOfLaw(state.law)));
    this.showCells(state);
    this.reportFailure("method", state.method_failed && refusalText(state.method_failed));
    this.reportFailure("law", state.law_failed && refusalText(state.law_failed));
    for (const name of HAPTIC_SWITCHES) byId<HTMLInputElement>(name).checked = state[name];
    if (this.limit.matches(":active")) return;
    this.limit.value = String(state.max_force_N);
    write(byId("limit-value"), quantity(state.max_force_N, "N"));
  }
  private showAwaited(of: "method" | "law", text: string | null): void {
    const line = byId(`${of}-awaited`);
    write(line, text ?? "");
    line.hidden = !text;
  }
  /** Says that a machine solves soft tissue in coarser cells than the scene requests. */
  private showCells({ law_cells: cells }: State): void {
    const isCoarser = cells !== null && cells.mm > cells.requested_mm;
    const line = byId("law-cells");
    write(line, isCoarser ? words.coarserCells(quantity(cells.mm, "mm"), quantity(cells.requested_mm, "mm")) : "");
    line.hidden = !isCoarser;
  }
  private reportFailure(of: "method" | "law", failure: string | null): void {
    if (failure && failure !== this.failures[of]) untracked(() => toast(failure));
    this.failures[of] = failure;
  }
}
