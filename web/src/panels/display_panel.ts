// Display of the scan and of the structures in sections: window, fill, outlines, slab, convention of positions.

import { effect, type Signal } from "@preact/signals-core";
import type { Scene } from "../protocol/messages.js";
import { byId, write } from "../base/dom.js";
import { quantity, stepsText } from "../words/figures.js";
import type { History } from "../state/history.js";
import { CT_PRESETS } from "../protocol/scene.js";
import type { Session, Slab } from "../state/session.js";
import { words, type Words } from "../words/words.js";

type Preset = keyof Words["presets"];

const percent = (fraction: number): string => `${Math.round(100 * fraction)} %`;

export class DisplayPanel {
  constructor(
    private readonly session: Session,
    private readonly history: History,
  ) {
    const preset = byId<HTMLSelectElement>("preset");
    preset.addEventListener("change", () => this.usePreset(preset.value as Preset));
    for (const name of ["level", "width"] as const) this.connectWindow(name);
    this.connectSlider("fill", session.fill);
    this.connectSlider("scan-in-volume", session.scanInVolume);
    for (const name of ["outlines", "strain"] as const) {
      const input = byId<HTMLInputElement>(name);
      input.addEventListener("change", () => (session[name].value = input.checked));
    }
    this.connectSlab();
    const convention = byId<HTMLSelectElement>("convention");
    convention.addEventListener("change", () => (session.convention.value = convention.value as "LPS" | "RAS"));
    session.onScene((scene) => this.showScene(scene));
    // at most once per update of the figures, because dragging changes the window more often
    session.onFigures(() => session.storeWindow());
  }

  private showScene({ modality, volume }: Scene): void {
    write(byId("scan-steps"), volume.scan ? stepsText(volume.scan.scale) : "");
    const presets: Preset[] = ["percentiles", "all"];
    if (modality === "ct") presets.push(...(Object.keys(CT_PRESETS) as Preset[]));
    offer("preset", presets, words.presets);
    offer("slab", ["none", "mean", "maximum", "minimum"], words.slabs);
  }
  private usePreset(name: Preset): void {
    const { session } = this;
    const scan = session.scene.value?.volume.scan;
    const between = ([low, high]: [number, number]) => ({ level: (low + high) / 2, width: high - low });
    this.history.change("window", () => {
      if (name !== "percentiles" && name !== "all") session.window.value = { ...CT_PRESETS[name] };
      else if (scan) session.window.value = between(name === "all" ? scan.range : scan.window);
    });
  }

  private connectWindow(name: "level" | "width"): void {
    const { session, history } = this;
    const input = byId<HTMLInputElement>(name);
    input.addEventListener("change", () => {
      const value = Number(input.value);
      if (Number.isFinite(value) && (name === "level" || value > 0))
        history.change("window", () => (session.window.value = { ...session.window.value, [name]: value }));
    });
    const show = () => (input.value = String(Number(session.window.value[name].toPrecision(5))));
    // not while the user is typing; a value that was not accepted is replaced afterwards
    input.addEventListener("blur", show);
    effect(() => {
      void session.window.value;
      if (document.activeElement !== input) show();
    });
  }
  private connectSlider(id: string, value: Signal<number>): void {
    const input = byId<HTMLInputElement>(id);
    input.addEventListener("input", () => (value.value = Number(input.value)));
    effect(() => {
      input.value = String(value.value);
      write(byId(`${id}-value`), percent(value.value));
    });
  }
  private connectSlab(): void {
    const { slab } = this.session;
    const kind = byId<HTMLSelectElement>("slab"),
      mm = byId<HTMLInputElement>("slab-mm");
    const choose = () => (slab.value = { kind: kind.value as Slab["kind"], mm: Number(mm.value) });
    kind.addEventListener("change", choose);
    mm.addEventListener("input", choose);
    effect(() => {
      kind.value = slab.value.kind;
      mm.value = String(slab.value.mm);
      mm.disabled = slab.value.kind === "none";
      write(byId("slab-mm-value"), quantity(slab.value.mm, "mm"));
    });
  }
}

/** Replaces the options of a select element, keeping the selection. */
function offer<Name extends string>(id: string, names: Name[], said: Record<Name, string>): void {
  const select = byId<HTMLSelectElement>(id);
  const chosen = select.value;
  select.replaceChildren(...names.map((name) => new Option(said[name], name, false, name === chosen)));
}
