// Picture on the page: two canvases of equal size, the rendering below the overlays.

import type { Frame } from "./overlay.js";
import { ObservedSize } from "../base/screen.js";
import { says } from "../words/words.js";

/** Kind of a picture; also the key of its name and help in the texts. */
export type PictureId = "volume" | "oblique" | "axial" | "sagittal" | "coronal" | "scope";

export class Picture {
  readonly element: HTMLElement;
  readonly base: CanvasRenderingContext2D;
  readonly over: CanvasRenderingContext2D;
  readonly head: HTMLElement;
  private readonly size: ObservedSize;

  constructor(id: PictureId) {
    this.element = document.createElement("section");
    this.element.className = `picture picture-${id}`;
    this.element.id = `picture-${id}`;
    says(this.element, { label: id });
    this.head = document.createElement("header");
    this.head.append(says(document.createElement("h2"), { text: id }));
    const stack = document.createElement("div");
    stack.className = "stack";
    stack.tabIndex = 0;
    stack.setAttribute("role", "application");
    says(stack, { label: `${id}About` });
    const canvases = [0, 1].map(() => document.createElement("canvas"));
    stack.append(...canvases);
    this.element.append(stack, this.head);
    this.base = canvases[0]!.getContext("2d", { alpha: false, willReadFrequently: false })!;
    this.over = canvases[1]!.getContext("2d")!;
    this.size = new ObservedSize(stack);
  }

  get surface(): HTMLElement {
    return this.element.firstElementChild as HTMLElement;
  }

  /**
   * Resizes the canvases to the element.
   * @returns whether the size has changed since the last call
   */
  fit(): boolean {
    const [isOther] = [this.base, this.over].map(({ canvas }) => this.size.fit(canvas));
    return isOther!;
  }
  get isShown(): boolean {
    // a hidden picture has no observed size
    const {
      size,
      base: { canvas },
    } = this;
    return size.width > 0 && size.height > 0 && canvas.width > 0 && canvas.height > 0;
  }
  frame(): Frame {
    return {
      context: this.over,
      width: this.base.canvas.width,
      height: this.base.canvas.height,
      ratio: this.size.ratio,
    };
  }
  /** Position of an event in canvas pixels. */
  at(event: { clientX: number; clientY: number }): [number, number] {
    const box = this.surface.getBoundingClientRect();
    return [(event.clientX - box.left) * this.size.ratio, (event.clientY - box.top) * this.size.ratio];
  }
}
