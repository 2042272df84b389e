// The list of structures by tissue: how each looks, and how its tissue feels.

import { byId, element, press, write } from "./dom.js";
import type { Requests } from "./requests.js";
import type { Rgb, Scene, State, Structure } from "./scene.js";
import { readable, type Session } from "./session.js";

const hex = (colour: Rgb): string => "#" + colour.map((x) => x.toString(16).padStart(2, "0")).join("");
const fromHex = (text: string): Rgb => [1, 3, 5].map((i) => parseInt(text.slice(i, i + 2), 16)) as Rgb;

/** Stiffness is felt by ratios: a slider from 0 to 1 over the logarithm. */
export const toSlider = (value: number, [low, high]: [number, number]): number =>
  Math.log(Math.max(value, low) / low) / Math.log(high / low);
export const fromSlider = (place: number, [low, high]: [number, number]): number =>
  Number((low * (high / low) ** place).toPrecision(3));

interface TissueRow { stiffness: HTMLInputElement; stiffnessValue: HTMLElement; friction: HTMLInputElement; frictionValue: HTMLElement }
const FRICTION_OF_STATIC = 0.75; // where a tissue had none, dynamic friction is so much of static friction

export class StructuresPanel {
  private rows: TissueRow[] = [];
  private readonly lines = new Map<number, HTMLElement>();

  constructor(private readonly session: Session, private readonly requests: Requests) {}

  build(scene: Scene): void {
    this.rows = [];
    this.lines.clear();
    const groups = scene.tissues.flatMap((tissue, place) => {
      const inside = scene.structures.filter((structure) => structure.tissue === place);
      return inside.length === 0 ? [] : element("fieldset", { className: "tissue" }, element("legend", {}, readable(tissue.name)),
        ...(tissue.felt ? [this.feelOf(scene, place)] : [element("p", { className: "quiet" }, "Shown, not felt")]),
        ...inside.map((structure) => this.lineOf(scene, structure)));
    });
    const rest = scene.structures.filter((structure) => structure.tissue < 0);
    if (rest.length > 0) groups.push(element("fieldset", { className: "tissue" }, element("legend", {}, "Not felt"),
      ...rest.map((structure) => this.lineOf(scene, structure))));
    byId("structures").replaceChildren(...groups);
  }

  private feelOf(scene: Scene, place: number): HTMLElement {
    const { stiffness_N_per_mm: range, friction } = scene.limits;
    // a slider of the stiffness that is wanted in practice, within what is valid
    const limits: [number, number] = [Math.max(range[0], 0.01), Math.min(range[1], 10)];
    const name = readable(scene.tissues[place]!.name);
    const slider = (label: string, max: number, step: number) => element("input", { type: "range", min: "0", max: String(max), step: String(step), ariaLabel: `${label} of ${name}` });
    const stiffness = slider("Stiffness", 1, 0.005);
    const frictionSlider = slider("Friction", Math.min(friction[1], 1.5), 0.01);
    stiffness.dataset.tissue = String(place);
    const row: TissueRow = {
      stiffness, friction: frictionSlider,
      stiffnessValue: element("output"), frictionValue: element("output"),
    };
    this.rows[place] = row;
    stiffness.addEventListener("input", () => {
      const value = fromSlider(Number(stiffness.value), limits);
      write(row.stiffnessValue, `${value} N/mm`);
      void this.requests.latest(`stiffness ${place}`, { type: "tissue", tissue: place, stiffness_N_per_mm: value });
    });
    frictionSlider.addEventListener("input", () => {
      const value = Number(frictionSlider.value);
      const before = this.session.state?.tissues[place];
      const ratio = before && before.static_friction > 0 ? before.dynamic_friction / before.static_friction : FRICTION_OF_STATIC;
      write(row.frictionValue, value.toFixed(2));
      void this.requests.latest(`friction ${place}`, { type: "tissue", tissue: place, static_friction: value, dynamic_friction: Number((value * ratio).toPrecision(4)) });
    });
    stiffness.dataset.low = String(limits[0]);
    stiffness.dataset.high = String(limits[1]);
    return element("div", { className: "feel" },
      element("label", { className: "line" }, element("span", {}, "Stiffness"), stiffness, row.stiffnessValue),
      element("label", { className: "line" }, element("span", {}, "Friction"), frictionSlider, row.frictionValue));
  }

  private lineOf(scene: Scene, structure: Structure): HTMLElement {
    const place = scene.structures.indexOf(structure);
    const { session } = this;
    const look = session.looks[place]!;
    const name = readable(structure.name);
    const colour = element("input", { type: "color", value: hex(look.colour), ariaLabel: `Colour of ${name}`, title: "Colour" });
    const opacity = element("input", { type: "range", min: "0", max: "1", step: "0.05", value: String(look.opacity), ariaLabel: `Opacity of ${name}`, title: "Opacity" });
    const shown = element("button", { type: "button", className: "eye", textContent: "Shown", ariaLabel: `Show ${name}` });
    press(shown, look.visible);
    colour.addEventListener("input", () => {
      look.colour = fromHex(colour.value);
      session.touchLooks();
    });
    opacity.addEventListener("input", () => {
      look.opacity = Number(opacity.value);
      session.touchLooks();
    });
    shown.addEventListener("click", () => {
      look.visible = !look.visible;
      press(shown, look.visible);
      write(shown, look.visible ? "Shown" : "Hidden");
      session.touchLooks();
    });
    const line = element("div", { className: "structure" }, colour, element("span", { className: "name", title: name }, name), opacity, shown);
    this.lines.set(structure.label, line);
    return line;
  }

  /** Sliders go to what holds, except the one that is being moved. */
  show(state: State, isAllowed: boolean): void {
    // a tissue that no structure is of has no row
    this.rows.forEach((row, place) => {
      const tissue = state.tissues[place];
      if (!tissue) return;
      const limits: [number, number] = [Number(row.stiffness.dataset.low), Number(row.stiffness.dataset.high)];
      if (!row.stiffness.matches(":active")) {
        row.stiffness.value = String(toSlider(tissue.stiffness_N_per_mm, limits));
        write(row.stiffnessValue, `${Number(tissue.stiffness_N_per_mm.toPrecision(3))} N/mm`);
      }
      if (!row.friction.matches(":active")) {
        row.friction.value = String(tissue.static_friction);
        write(row.frictionValue, tissue.static_friction.toFixed(2));
      }
      row.stiffness.disabled = row.friction.disabled = !isAllowed;
    });
  }

  /** Marks what is touched. */
  touched(label: number): void {
    for (const [own, line] of this.lines) line.classList.toggle("touched", own === label && label > 0);
  }
}
