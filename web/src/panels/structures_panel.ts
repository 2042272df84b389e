// Panel of the structures by tissue: controls of each structure's appearance and of each tissue's contact properties.

import { effect, untracked } from "@preact/signals-core";
import type { Rgb, Scene, State, Structure } from "../protocol/messages.js";
import { byId, element, press, write } from "../base/dom.js";
import { digits, quantity } from "../words/figures.js";
import type { History } from "../state/history.js";
import { storeScene } from "../state/local_storage.js";
import {
  hasBone,
  storedAppearances,
  presetAppearances,
  PRESETS,
  type AppearancePreset,
  type Appearance,
} from "../state/appearance.js";
import type { Permissions } from "../state/permissions.js";
import type { Requests } from "../state/requests.js";
import { readable, type StoredScene, type Session } from "../state/session.js";
import { setMessages, words, type MessageAbout } from "../words/words.js";

const hex = (colour: Rgb): string => "#" + colour.map((x) => x.toString(16).padStart(2, "0")).join("");
const fromHex = (text: string): Rgb => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16)) as Rgb;

/** Slider position, 0 to 1, of a stiffness; logarithmic, because equal ratios of stiffness feel equally different. */
export const toSlider = (value: number, [low, high]: [number, number]): number =>
  Math.log(Math.max(value, low) / low) / Math.log(high / low);
/** Inverse of toSlider(), rounded to three digits. */
export const fromSlider = (index: number, [low, high]: [number, number]): number =>
  Number((low * (high / low) ** index).toPrecision(3));

/** Whether a name contains every word of a search, in any order. */
export const isFound = (name: string, wanted: string): boolean =>
  wanted
    .toLowerCase()
    .split(/\s+/)
    .every((word) => readable(name).toLowerCase().includes(word));

/** Controls of a tissue's contact properties, and the texts of their values. */
interface TissueControls {
  stiffness: HTMLInputElement;
  stiffnessValue: HTMLElement;
  friction: HTMLInputElement;
  frictionValue: HTMLElement;
}
/** Structures of one tissue, or all structures without a tissue; folded and switched on and off together. */
interface Group {
  tissue: number; // index in the scene; -1: none
  indices: number[]; // indices of its structures in the scene
  box: HTMLElement;
  fold: HTMLElement;
  eye: HTMLElement;
  rows: HTMLElement;
}
/** Ratio of kinetic to static friction for a tissue without friction, whose own ratio is undefined. */
const KINETIC_TO_STATIC = 0.75;

export class StructuresPanel {
  private rows: TissueControls[] = []; // by index of the tissue; sparse
  private readonly rowOf = new Map<number, HTMLElement>(); // row of each structure, by label
  // controls of each structure, by index in the scene
  private controls: { eye: HTMLButtonElement; colour: HTMLInputElement; opacity: HTMLInputElement }[] = [];
  private shownAppearances: Appearance[] = []; // displayed by the controls
  private groups: Group[] = [];
  private readonly folded = new Set<number>(); // indices of folded tissues
  private focusedRow: HTMLElement | null = null; // row whose controls are in the tab order; null: none is visible
  // structure that is shown alone, and the visibility of each structure before that; null: none
  private alone: { index: number; before: boolean[] } | null = null;

  constructor(
    private readonly session: Session,
    private readonly requests: Requests,
    private readonly history: History,
    private readonly permissions: Permissions,
  ) {
    byId("find").addEventListener("input", () => this.find());
    byId("find").addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      byId<HTMLInputElement>("find").value = "";
      this.find();
    });
    byId("structures").addEventListener("keydown", (event) => this.onArrowKey(event));
    byId("structures").addEventListener("focusin", (event) => {
      const line = (event.target as HTMLElement).closest<HTMLElement>(".structure");
      if (line && line !== this.focusedRow) this.setFocusedRow(line);
    });
    const choice = byId<HTMLSelectElement>("looks");
    choice.addEventListener("change", () => {
      if (choice.value)
        this.change(
          "looks",
          presetAppearances(choice.value as AppearancePreset, session.scene.value!, session.appearances.value),
        );
      choice.value = "";
    });
    byId("show-all").addEventListener("click", () => this.setShown(session.appearances.value.map(() => true)));
    byId("hide-all").addEventListener("click", () => this.setShown(session.appearances.value.map(() => false)));
    session.onScene((scene) => untracked(() => this.build(scene)));
    session.onScene((scene) => this.offerPresets(scene));
    session.onState((state) => {
      // when a refusal resets the sliders, too
      void requests.refusals.value;
      this.show(state);
    });
    effect(() => this.showAppearances(session.appearances.value));
    session.onFigures(() => {
      const device = session.pose.value?.devices[0];
      if (device) this.touched(session.contactOf(device).label);
    });
  }

  /** Rebuilds the panel for a scene. */
  private build(scene: Scene): void {
    const { session } = this;
    this.rows = [];
    this.rowOf.clear();
    this.controls = [];
    this.alone = null;
    this.groups = scene.tissues.flatMap((tissue, index) =>
      this.groupOf(
        scene,
        index,
        readable(tissue.name),
        tissue.touchable
          ? this.createTissueControls(scene, index)
          : setMessages(element("p", { className: "quiet" }), { text: "shownNotTouchable" }),
      ),
    );
    this.groups.push(...this.groupOf(scene, -1, null, null));
    byId("caveats").replaceChildren(...scene.caveats.map(({ text }) => element("li", {}, text)));
    byId("caveats").hidden = scene.caveats.length === 0;
    byId("structures").replaceChildren(...this.groups.map(({ box }) => box));
    this.shownAppearances = [];
    this.showAppearances(session.appearances.value);
    if (session.state.value) this.show(session.state.value);
    this.find();
  }

  /**
   * Builds the group of a tissue; empty if the tissue has no structures.
   * @param tissue  index of the tissue; -1: structures without a tissue
   * @param name    name of the tissue; null: structures without a tissue
   * @param feel    controls of the contact properties, or a note in their place; null: nothing
   */
  private groupOf(scene: Scene, tissue: number, name: string | null, feel: HTMLElement | null): Group[] {
    const indices = scene.structures.flatMap((structure, index) =>
      structure.tissue === tissue || (tissue < 0 && structure.tissue < 0) ? [index] : [],
    );
    if (indices.length === 0) return [];
    const title = element("span", { className: "title" });
    const fold = element(
      "button",
      { type: "button", className: "fold" },
      title,
      element("span", { className: "quiet" }, String(indices.length)),
    );
    if (name === null) setMessages(title, { text: "notTouchable" });
    else write(title, name);
    const eye = element("button", { type: "button", className: "eye" });
    if (name === null) setMessages(eye, { label: "showNotTouchable" });
    else setMessages(eye, { label: "showGroup" }, name);
    const rows = element(
      "div",
      { id: `tissue-${tissue}` },
      ...(feel ? [feel] : []),
      ...indices.map((index) => this.createRow(scene, scene.structures[index]!)),
    );
    fold.setAttribute("aria-controls", rows.id);
    const box = element("div", { className: "tissue" }, element("div", { className: "head" }, fold, eye), rows);
    fold.addEventListener("click", () => {
      if (!this.folded.delete(tissue)) this.folded.add(tissue);
      this.find();
    });
    eye.addEventListener("click", () => {
      const appearances = this.session.appearances.value;
      const isShown = !indices.every((index) => appearances[index]!.visible);
      this.setShown(appearances.map((appearance, index) => (indices.includes(index) ? isShown : appearance.visible)));
    });
    return [{ tissue, indices, box, fold, eye, rows }];
  }
  /** Updates the visibility buttons of the groups: all, some or none of the structures are visible. */
  private showGroups(appearances: Appearance[]): void {
    for (const { indices, eye } of this.groups) {
      const count = indices.filter((index) => appearances[index]!.visible).length;
      const isAll = count === indices.length;
      eye.setAttribute("aria-pressed", isAll ? "true" : count === 0 ? "false" : "mixed");
      setMessages(eye, { text: isAll ? "shown" : count === 0 ? "hidden" : "partly" });
    }
  }

  /** Hides rows that do not match the search. Groups are folded only while the search is empty. */
  private find(): void {
    const wanted = byId<HTMLInputElement>("find").value.trim();
    for (const structure of this.session.scene.value?.structures ?? []) {
      this.rowOf.get(structure.label)!.hidden = !isFound(structure.name, wanted);
    }
    for (const { tissue, box, fold, rows } of this.groups) {
      box.hidden = box.querySelector(".structure:not([hidden])") === null;
      rows.hidden = wanted === "" && this.folded.has(tissue);
      fold.setAttribute("aria-expanded", String(!rows.hidden));
    }
    byId("none-found").hidden = this.groups.some(({ box }) => !box.hidden);
    this.setFocusedRow(this.focusedRow);
  }

  /**
   * Makes a row the only one whose controls are in the tab order; if it is hidden, the first visible row instead. Arrow
   * keys move between rows (roving tabindex).
   */
  private setFocusedRow(wanted: HTMLElement | null): void {
    const shown = [...this.rowOf.values()].filter((line) => line.closest("[hidden]") === null);
    this.focusedRow = wanted && shown.includes(wanted) ? wanted : (shown[0] ?? null);
    for (const line of this.rowOf.values()) {
      for (const control of line.children) (control as HTMLElement).tabIndex = line === this.focusedRow ? 0 : -1;
    }
  }
  /** Moves the focus to the same control of another visible row. */
  private onArrowKey(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    const line = target.closest<HTMLElement>(".structure");
    // arrow keys change the value of a slider
    if (!line || target.matches("input[type=range]") || event.ctrlKey || event.metaKey || event.altKey) return;
    const shown = [...this.rowOf.values()].filter((one) => one.closest("[hidden]") === null);
    const index = shown.indexOf(line);
    const next = {
      ArrowUp: index - 1,
      ArrowDown: index + 1,
      PageUp: Math.max(0, index - 10),
      PageDown: Math.min(shown.length - 1, index + 10),
      Home: 0,
      End: shown.length - 1,
    }[event.key];
    const to = next === undefined ? undefined : shown[next];
    if (!to) return;
    event.preventDefault();
    (to.children[[...line.children].indexOf(target)] as HTMLElement).focus();
  }

  /** Fills the menu with the presets that apply to this scene. A preset is an action: nothing stays selected. */
  private offerPresets(scene: Scene): void {
    const names = PRESETS.filter((name) => hasBone(scene) || name === "scene" || name === "solid");
    byId("looks").replaceChildren(
      new Option(words.appearancePreset, ""),
      ...names.map((name) => new Option(words.appearances[name], name)),
    );
  }

  /**
   * Changes appearances as an undo step.
   * @param key  changes with equal key in one gesture are one undo step
   */
  private change(key: string, appearances: Appearance[]): void {
    this.history.push(key, {
      before: this.session.appearances.value,
      after: appearances,
      apply: (_, to) => this.setAppearances(to),
    });
    this.setAppearances(appearances);
  }
  /** Sets and stores the appearances of all structures. Returns true: an undo of appearances cannot be refused. */
  private setAppearances(appearances: Appearance[]): boolean {
    this.alone = null;
    this.session.appearances.value = appearances;
    const scene = this.session.scene.value!;
    storeScene<StoredScene>(scene.volume.hash, { looks: storedAppearances(scene, appearances) });
    return true;
  }
  /** Shows the appearances that differ from the displayed ones. */
  private showAppearances(appearances: Appearance[]): void {
    // appearances of another scene, whose list is not built yet
    if (appearances.length !== this.controls.length) return;
    appearances.forEach(
      (appearance, index) => appearance !== this.shownAppearances[index] && this.showAppearance(appearance, index),
    );
    this.shownAppearances = appearances;
    this.showGroups(appearances);
  }
  private showAppearance({ colour, opacity, visible }: Appearance, index: number): void {
    const controls = this.controls[index]!;
    press(controls.eye, visible);
    setMessages(controls.eye, { text: visible ? "shown" : "hidden" });
    controls.colour.value = hex(colour);
    controls.opacity.value = String(opacity);
  }
  /** Changes the appearance of one structure. */
  private changeOne(index: number, key: string, appearance: Partial<Appearance>): void {
    this.change(
      `${key} ${index}`,
      this.session.appearances.value.map((one, other) => (other === index ? { ...one, ...appearance } : one)),
    );
  }
  /** Sets the visibility of every structure as one undo step. */
  private setShown(shown: boolean[], alone: StructuresPanel["alone"] = null): void {
    this.history.gesture += 1;
    this.change(
      "shown",
      this.session.appearances.value.map((appearance, index) => ({ ...appearance, visible: shown[index]! })),
    );
    this.alone = alone;
  }
  /** Hides all other structures, or restores their visibility if the structure is already shown alone. */
  private toggleAlone(index: number): void {
    const shown = this.session.appearances.value.map((appearance) => appearance.visible);
    if (this.alone?.index === index) this.setShown(this.alone.before);
    else
      this.setShown(
        shown.map((_, other) => other === index),
        { index, before: this.alone?.before ?? shown },
      );
  }

  /** Sliders of a tissue's stiffness and static friction. */
  private createTissueControls(scene: Scene, index: number): HTMLElement {
    const { stiffness_N_per_mm: range, friction } = scene.limits;
    // range of the slider, N/mm: useful stiffnesses, as far as they are valid
    const limits: [number, number] = [Math.max(range[0], 0.01), Math.min(range[1], 10)];
    const name = readable(scene.tissues[index]!.name);
    const slider = (label: MessageAbout, max: number, step: number) =>
      setMessages(element("input", { type: "range", min: "0", max: String(max), step: String(step) }), { label }, name);
    const stiffness = slider("stiffnessOf", 1, 0.005);
    const frictionSlider = slider("frictionOf", Math.min(friction[1], 1.5), 0.01);
    stiffness.dataset.tissue = String(index);
    const row: TissueControls = {
      stiffness,
      friction: frictionSlider,
      stiffnessValue: element("output"),
      frictionValue: element("output"),
    };
    this.rows[index] = row;
    stiffness.addEventListener("input", () => {
      const value = fromSlider(Number(stiffness.value), limits);
      write(row.stiffnessValue, quantity(value, "N/mm"));
      void this.requests.latest(`stiffness ${index}`, { type: "tissue", tissue: index, stiffness_N_per_mm: value });
    });
    frictionSlider.addEventListener("input", () => {
      const value = Number(frictionSlider.value);
      const before = this.session.state.value?.tissues[index];
      const ratio = before && before.static_friction > 0 ? before.friction / before.static_friction : KINETIC_TO_STATIC;
      write(row.frictionValue, digits(value));
      void this.requests.latest(`friction ${index}`, {
        type: "tissue",
        tissue: index,
        static_friction: value,
        friction: Number((value * ratio).toPrecision(4)),
      });
    });
    stiffness.dataset.low = String(limits[0]);
    stiffness.dataset.high = String(limits[1]);
    return element(
      "div",
      { className: "feel" },
      element(
        "label",
        { className: "line" },
        setMessages(element("span"), { text: "stiffness" }),
        stiffness,
        row.stiffnessValue,
      ),
      element(
        "label",
        { className: "line" },
        setMessages(element("span"), { text: "friction" }),
        frictionSlider,
        row.frictionValue,
      ),
    );
  }

  /** Row of a structure: colour, name, opacity, visibility. */
  private createRow(scene: Scene, structure: Structure): HTMLElement {
    const index = scene.structures.indexOf(structure);
    const { session } = this;
    const name = readable(structure.name);
    const colour = setMessages(element("input", { type: "color" }), { label: "colourOf", title: "colour" }, name);
    const opacity = setMessages(
      element("input", { type: "range", min: "0", max: "1", step: "0.05" }),
      { label: "opacityOf", title: "opacity" },
      name,
    );
    const eye = setMessages(element("button", { type: "button", className: "eye" }), { label: "show" }, name);
    this.controls[index] = { eye, colour, opacity };
    colour.addEventListener("input", () => this.changeOne(index, "colour", { colour: fromHex(colour.value) }));
    opacity.addEventListener("input", () => this.changeOne(index, "opacity", { opacity: Number(opacity.value) }));
    eye.addEventListener("click", () =>
      this.setShown(session.appearances.value.map((one, other) => (other === index ? !one.visible : one.visible))),
    );
    const alone = setMessages(
      element("button", { type: "button", className: "name", textContent: name }),
      { title: "alone" },
      name,
    );
    alone.addEventListener("click", () => this.toggleAlone(index));
    const line = element("div", { className: "structure" }, colour, alone, opacity, eye);
    this.rowOf.set(structure.label, line);
    return line;
  }

  /** Sets the sliders to the current values, except one that is being dragged. */
  private show(state: State): void {
    const isAllowed = this.permissions.changeContact.value;
    // visits existing rows only: tissues without contact or structures have none
    this.rows.forEach((row, index) => {
      const tissue = state.tissues[index];
      if (!tissue) return;
      const limits: [number, number] = [Number(row.stiffness.dataset.low), Number(row.stiffness.dataset.high)];
      if (!row.stiffness.matches(":active")) {
        row.stiffness.value = String(toSlider(tissue.stiffness_N_per_mm, limits));
        write(row.stiffnessValue, quantity(tissue.stiffness_N_per_mm, "N/mm"));
      }
      if (!row.friction.matches(":active")) {
        row.friction.value = String(tissue.static_friction);
        write(row.frictionValue, digits(tissue.static_friction));
      }
      row.stiffness.disabled = row.friction.disabled = !isAllowed;
    });
  }

  /** Highlights the row of the structure in contact; 0: none. */
  private touched(label: number): void {
    for (const [own, line] of this.rowOf) line.classList.toggle("touched", own === label && label > 0);
  }
}
