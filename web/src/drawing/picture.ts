// Picture on the page: two canvases of equal size, the rendering below the overlays.

import type { Frame } from "./overlay.js";
import { ObservedSize } from "../base/screen.js";
import { setMessages } from "../words/words.js";

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
    setMessages(this.element, { label: id });
    this.head = document.createElement("header");
    this.head.append(setMessages(document.createElement("h2"), { text: id }));
    const stack = document.createElement("div");
    stack.className = "stack";
    stack.tabIndex = 0;
    stack.setAttribute("role", "application");
    setMessages(stack, { label: `${id}About` });
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
   * Resizes the canvases to the element. Until it is redrawn, the picture keeps its extent across the shorter side; a
   * hidden one keeps its contents.
   * @returns whether the size has changed since the last call
   */
  fit(): boolean {
    const { size, base, over } = this;
    if (size.width === 0 || size.height === 0) return false;
    const [width, height] = [base.canvas.width, base.canvas.height];
    if (width === size.width && height === size.height) return false;
    const before = document.createElement("canvas");
    if (width > 0 && height > 0) {
      [before.width, before.height] = [width, height];
      before.getContext("2d", { alpha: false })!.drawImage(base.canvas, 0, 0);
    }
    for (const { canvas } of [base, over]) size.fit(canvas);
    if (width > 0 && height > 0) this.drawScaled(before, width, height);
    return true;
  }
  /** Factor from a picture of a given size to this one, of which both show the same extent across the shorter side. */
  scaleOf(width: number, height: number): number {
    const { canvas } = this.base;
    return Math.min(canvas.width, canvas.height) / Math.min(width, height);
  }
  /** Draws a picture of `width` x `height` pixels, scaled, in the middle. */
  drawScaled(source: CanvasImageSource, width: number, height: number): void {
    const { base } = this;
    const factor = this.scaleOf(width, height);
    const [w, h] = [factor * width, factor * height];
    base.imageSmoothingQuality = "high";
    base.drawImage(source, (base.canvas.width - w) / 2, (base.canvas.height - h) / 2, w, h);
  }
  /** Whether the canvases have the size of the element in the current layout, or it is hidden. */
  get isFitted(): boolean {
    const { surface, size, base } = this;
    const is = (inside: number, observed: number, drawn: number) =>
      Math.round(inside * size.ratio) === observed && (observed === 0 || observed === drawn);
    return (
      is(surface.clientWidth, size.width, base.canvas.width) &&
      is(surface.clientHeight, size.height, base.canvas.height)
    );
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
