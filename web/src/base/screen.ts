// Resources of the machine that shows the page: pixels and memory.

import { signal } from "@preact/signals-core";

/** Canvas pixels per CSS pixel, limited to two: a higher resolution costs time and is hardly visible. */
export function pixelRatio(): number {
  return Math.min(window.devicePixelRatio || 1, 2);
}
/** Memory of the machine as reported by the browser; 8: at least 8, or unknown. */
export function memory_GB(): number {
  return (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
}

/**
 * Size of an element's client box in canvas pixels, as of its last layout (a query would force a layout). 0 while the
 * element is hidden.
 */
export class ObservedSize {
  private readonly inside = signal<[number, number]>([0, 0]); // width and height, CSS pixels

  constructor(element: Element) {
    new ResizeObserver(() => (this.inside.value = [element.clientWidth, element.clientHeight])).observe(element);
  }
  /** Canvas pixels per CSS pixel on the current screen. */
  get ratio(): number {
    return pixelRatio();
  }
  get width(): number {
    return Math.round(this.inside.value[0] * this.ratio);
  }
  get height(): number {
    return Math.round(this.inside.value[1] * this.ratio);
  }
  /**
   * Resizes a canvas to this size.
   * @returns whether the canvas's size has changed
   */
  fit(canvas: HTMLCanvasElement): boolean {
    if (canvas.width === this.width && canvas.height === this.height) return false;
    [canvas.width, canvas.height] = [this.width, this.height];
    return true;
  }
}
