// List of measures: renaming, navigation to a measure, deletion, export as a table.

import { byId, element } from "../base/dom.js";
import { download, fileStem } from "../base/download.js";
import type { History } from "../state/history.js";
import { measureText, measuresTable, type Measure } from "../drawing/measure.js";
import type { Session } from "../state/session.js";
import { says, words } from "../words/words.js";

export class Measures {
  private list: Measure[] = [];
  private made = 0; // number of measures made since the page was opened, for their default names

  /** @param goTo  moves the planes to a measure */
  constructor(
    private readonly session: Session,
    private readonly history: History,
    private readonly goTo: (measure: Measure) => void,
  ) {
    byId("clear").addEventListener("click", () => this.change([]));
    byId("measures-csv").addEventListener("click", () =>
      download(new Blob([measuresTable(this.list)], { type: "text/csv" }), `${fileStem()}-measures.csv`),
    );
    this.show();
  }

  get all(): readonly Measure[] {
    return this.list;
  }
  add(measure: Omit<Measure, "name">): void {
    this.made += 1;
    this.change([...this.list, { ...measure, name: `${words[measure.kind]} ${this.made}` }]);
  }
  /** Discards all measures, when another patient is loaded. */
  forget(): void {
    this.set([]);
  }

  private change(list: Measure[]): void {
    if (list.length === 0 && this.list.length === 0) return;
    this.note(list);
    this.set(list);
  }
  private note(list: Measure[]): void {
    this.history.gesture += 1;
    this.history.note("measures", { before: this.list, after: list, go: (_, to) => this.set(to) });
  }
  private set(list: Measure[]): boolean {
    this.list = list;
    this.show();
    this.session.touch();
    return true;
  }

  private show(): void {
    byId("no-measures").hidden = this.list.length > 0;
    byId("measures-csv").hidden = this.list.length === 0;
    byId("measures").replaceChildren(...this.list.map((measure, place) => this.lineOf(measure, place)));
  }
  private lineOf(measure: Measure, place: number): HTMLElement {
    const name = says(element("input", { type: "text", value: measure.name, autocomplete: "off", spellcheck: false }), {
      label: "measureName",
    });
    // updates the row in place, because the focus is moving within it
    name.addEventListener("change", () => {
      const list = this.list.map((one, other) => (other === place ? { ...one, name: name.value } : one));
      this.note(list);
      this.list = list;
      says(go, { title: "goToMeasure" }, name.value);
      says(remove, { label: "deleteNamed", title: "deleteNamed" }, name.value);
    });
    // moves the focus out of the text field, in which the space bar is not the emergency stop
    name.addEventListener("keydown", (event) => event.key === "Enter" && go.focus());
    const go = says(
      element("button", { type: "button", className: "figure", textContent: measureText(measure) }),
      { title: "goToMeasure" },
      measure.name,
    );
    go.addEventListener("click", () => this.goTo(measure));
    const remove = says(
      element("button", { type: "button", textContent: "×" }),
      { label: "deleteNamed", title: "deleteNamed" },
      measure.name,
    );
    remove.addEventListener("click", () => {
      this.change(this.list.filter((_, other) => other !== place));
      // keeps the focus in the list
      (
        byId("measures").querySelectorAll<HTMLElement>("button:last-child")[Math.min(place, this.list.length - 1)] ??
        byId("clear")
      ).focus();
    });
    return element("li", {}, name, go, remove);
  }
}
