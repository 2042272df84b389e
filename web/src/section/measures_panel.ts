// List of measures: renaming, navigation to a measure, deletion, export as a table.

import { effect, signal } from "@preact/signals-core";
import { byId, element } from "../base/dom.js";
import { download, fileStem } from "../base/download.js";
import type { History } from "../state/history.js";
import { measureText, measuresTable, type Measure } from "../drawing/measure.js";
import { setMessages, words } from "../words/words.js";

export class Measures {
  readonly list = signal<readonly Measure[]>([]);
  private shown: readonly Measure[] | null = null; // displayed measures
  private made = 0; // number of measures made since the page was opened, for their default names

  /** @param moveTo  moves the planes to a measure */
  constructor(
    private readonly history: History,
    private readonly moveTo: (measure: Measure) => void,
  ) {
    byId("clear").addEventListener("click", () => this.change([]));
    byId("measures-csv").addEventListener("click", () =>
      download(new Blob([measuresTable(this.list.value)], { type: "text/csv" }), `${fileStem()}-measures.csv`),
    );
    effect(() => this.show(this.list.value));
  }

  add(measure: Omit<Measure, "name">): void {
    this.made += 1;
    this.change([...this.list.value, { ...measure, name: `${words[measure.kind]} ${this.made}` }]);
  }
  /** Discards all measures, when another patient is loaded. */
  forget(): void {
    this.set([]);
  }

  private change(list: readonly Measure[]): void {
    if (list.length === 0 && this.list.value.length === 0) return;
    this.note(list);
    this.set(list);
  }
  private note(list: readonly Measure[]): void {
    this.history.gesture += 1;
    this.history.push("measures", { before: this.list.value, after: list, apply: (_, to) => this.set(to) });
  }
  private set(list: readonly Measure[]): boolean {
    this.list.value = list;
    return true;
  }

  private show(list: readonly Measure[]): void {
    if (list === this.shown) return;
    this.shown = list;
    byId("no-measures").hidden = list.length > 0;
    byId("measures-csv").hidden = list.length === 0;
    byId("measures").replaceChildren(...list.map((measure, index) => this.lineOf(measure, index)));
  }
  private lineOf(measure: Measure, index: number): HTMLElement {
    const name = setMessages(
      element("input", { type: "text", value: measure.name, autocomplete: "off", spellcheck: false }),
      {
        label: "measureName",
      },
    );
    // updates the row in place, because the focus is moving within it
    name.addEventListener("change", () => {
      const list = this.list.value.map((one, other) => (other === index ? { ...one, name: name.value } : one));
      this.note(list);
      this.shown = this.list.value = list;
      setMessages(button, { title: "goToMeasure" }, name.value);
      setMessages(remove, { label: "deleteNamed", title: "deleteNamed" }, name.value);
    });
    // moves the focus out of the text field, in which the space bar is not the emergency stop
    name.addEventListener("keydown", (event) => event.key === "Enter" && button.focus());
    const button = setMessages(
      element("button", { type: "button", className: "figure", textContent: measureText(measure) }),
      { title: "goToMeasure" },
      measure.name,
    );
    button.addEventListener("click", () => this.moveTo(measure));
    const remove = setMessages(
      element("button", { type: "button", textContent: "×" }),
      { label: "deleteNamed", title: "deleteNamed" },
      measure.name,
    );
    remove.addEventListener("click", () => {
      this.change(this.list.value.filter((_, other) => other !== index));
      // keeps the focus in the list
      (
        byId("measures").querySelectorAll<HTMLElement>("button:last-child")[
          Math.min(index, this.list.value.length - 1)
        ] ?? byId("clear")
      ).focus();
    });
    return element("li", {}, name, button, remove);
  }
}
