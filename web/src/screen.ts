// What the page may take of the machine that shows it.

/** Of a picture in one of the page, at most two: more costs time and is hardly seen. */
export function pixelRatio(): number {
  return Math.min(window.devicePixelRatio || 1, 2);
}
/** Of the machine, as far as the browser tells: 8 are "8 or more", or not known. */
export function memory_GB(): number {
  return (navigator as { deviceMemory?: number }).deviceMemory ?? 8;
}

/** Whole pixels of an element's inside, as it was laid out last: to ask for that would lay out the page between two frames. 0 where it is not shown. */
export class ObservedSize {
  private inside: [number, number] = [0, 0]; // of the page's

  constructor(element: Element) {
    new ResizeObserver(() => (this.inside = [element.clientWidth, element.clientHeight])).observe(element);
  }
  /** Canvas pixels of one of the page: of the screen that it is on now. */
  get ratio(): number {
    return pixelRatio();
  }
  get width(): number {
    return Math.round(this.inside[0] * this.ratio);
  }
  get height(): number {
    return Math.round(this.inside[1] * this.ratio);
  }
  /** Gives a canvas these pixels. @returns whether it had others */
  fit(canvas: HTMLCanvasElement): boolean {
    if (canvas.width === this.width && canvas.height === this.height) return false;
    [canvas.width, canvas.height] = [this.width, this.height];
    return true;
  }
}
