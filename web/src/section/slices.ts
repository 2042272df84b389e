// Slices along a normal, and their selection by a number or by a slider at the right edge of the picture, which a
// second finger may operate while the first one holds the tip.

import { element, write } from "../base/dom.js";
import { apply, column, dot, length, normalize, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";
import { setMessages, words } from "../words/words.js";

/** Slices with a common normal: offset of the first one along it, spacing, and count. */
export interface Slices {
  first_mm: number;
  step_mm: number;
  count: number;
}

/** Cosine of the angle to a grid axis above which a normal's slices are the grid's own. */
const ALONG = 1 - 1e-6;

export function slicesAlong(volumes: Volumes, normal: Vec3): Slices {
  const edges = [0, 1, 2].map((axis) => column(volumes.patientFromVoxel, axis));
  const own = edges.find((edge) => Math.abs(dot(normalize(edge), normal)) > ALONG);
  const step_mm = own ? length(own) : volumes.voxelSize;
  const corners = Array.from(
    { length: 8 },
    (_, n) => volumes.dims.map((size, axis) => (n >> axis) & 1 && size - 1) as Vec3,
  );
  const distances = corners.map((corner) => dot(apply(volumes.patientFromVoxel, corner), normal));
  const first_mm = Math.min(...distances);
  return { first_mm, step_mm, count: Math.round((Math.max(...distances) - first_mm) / step_mm) + 1 };
}

/** Number, counted from 1, of the slice nearest to an offset along the normal. */
export const sliceAt = ({ first_mm, step_mm, count }: Slices, distance_mm: number): number =>
  Math.min(count, Math.max(1, Math.round((distance_mm - first_mm) / step_mm) + 1));

/** Number of slices per key press, the same as in the picture. */
const STEPS: Record<string, number> = {
  ArrowUp: -1,
  ArrowLeft: -1,
  ArrowDown: 1,
  ArrowRight: 1,
  PageUp: -10,
  PageDown: 10,
  Home: -Infinity,
  End: Infinity,
};

export class SliceChooser {
  readonly element: HTMLElement;
  private readonly slider = setMessages(element("input", { type: "range", min: "1" }), {
    label: "slice",
    title: "slice",
  });
  private readonly number = setMessages(element("input", { type: "number", min: "1" }), {
    label: "sliceNumber",
    title: "sliceNumber",
  });
  private readonly total = element("span");
  private shown = { slice: 0, count: 0 };

  /** @param begin  called when a movement of the slider begins */
  constructor(
    private readonly choose: (slice: number) => void,
    begin: () => void,
  ) {
    // pointer events on the track, because a native slider follows the first finger only
    const track = element("div", { className: "track" }, this.slider);
    const at = (event: PointerEvent) => {
      const { top, height } = track.getBoundingClientRect();
      this.showSlice(1 + Math.round(((event.clientY - top) / Math.max(1, height)) * (this.shown.count - 1)));
    };
    track.addEventListener("pointerdown", (event) => {
      if (event.button !== 0) return;
      track.setPointerCapture(event.pointerId);
      this.slider.focus({ preventScroll: true });
      event.preventDefault();
      begin();
      at(event);
    });
    track.addEventListener("pointermove", (event) => track.hasPointerCapture(event.pointerId) && at(event));
    this.slider.addEventListener("keydown", (event) => {
      const by = STEPS[event.key];
      if (by === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      if (!event.repeat) begin();
      this.showSlice(this.shown.slice + by);
    });
    // changes by assistive technology
    this.slider.addEventListener("input", () => this.showSlice(Number(this.slider.value)));
    this.number.addEventListener("change", () => {
      begin();
      this.showSlice(Number(this.number.value));
    });
    this.element = element("div", { className: "slices" }, track, this.number, this.total);
  }

  private showSlice(slice: number): void {
    if (Number.isNaN(slice) || this.shown.count === 0) return;
    this.choose(Math.min(this.shown.count, Math.max(1, Math.round(slice))));
  }

  show(slice: number, count: number): void {
    const { shown, slider, number } = this;
    if (count !== shown.count) {
      slider.max = number.max = String(count);
      write(this.total, `/ ${count}`);
    }
    if (slice !== shown.slice || count !== shown.count) {
      slider.value = String(slice);
      if (document.activeElement !== number) number.value = String(slice);
    }
    slider.setAttribute("aria-valuetext", words.sliceOf(String(slice), String(count)));
    this.shown = { slice, count };
  }
}
