// Small plots over time: buffered samples, drawn on a canvas in the colours of the theme.

import { ObservedSize } from "../base/screen.js";
import { themeColour } from "./theme.js";

export interface Curve {
  colour: string;
  samples: number[];
}

/** Marker of an event, drawn over the curves. */
export interface Mark {
  time: number;
  text: string;
  colour: string;
}

export class Plot {
  band: [number, number] | null = null; // range of accepted values; null: none
  limit: number | null = null; // upper limit of the values, drawn as a line; null: none
  marks: Mark[] = [];
  private readonly context: CanvasRenderingContext2D;
  private readonly times: number[] = [];
  private readonly curves: Curve[];
  private readonly size: ObservedSize;

  /** @param colours  colour of each curve, as the name of a custom property of the style sheet */
  constructor(
    private readonly canvas: HTMLCanvasElement,
    colours: string[],
    private readonly span_s: number,
    private readonly leastTop: number,
  ) {
    this.context = canvas.getContext("2d")!;
    this.size = new ObservedSize(canvas);
    this.curves = colours.map((colour) => ({ colour, samples: [] }));
  }

  /** @param time_s  session time; a time before the previous one clears the plot */
  push(time_s: number, values: number[]): void {
    if (this.times.length > 0 && time_s <= this.times.at(-1)!) {
      if (time_s === this.times.at(-1)) return;
      this.times.length = 0;
      for (const curve of this.curves) curve.samples.length = 0;
    }
    this.times.push(time_s);
    this.curves.forEach((curve, i) => curve.samples.push(values[i]!));
    // removes samples in batches, because each removal from the front moves all others
    const old = this.times.findIndex((time) => time >= time_s - this.span_s);
    if (old > 200) {
      this.times.splice(0, old);
      for (const curve of this.curves) curve.samples.splice(0, old);
    }
  }

  draw(): void {
    const { width: w, height: h, ratio } = this.size;
    if (w === 0 || h === 0) return;
    this.size.fit(this.canvas);
    const c = this.context;
    c.clearRect(0, 0, w, h);
    const shown = this.curves.flatMap((curve) => curve.samples).filter(Number.isFinite);
    const top = niceTop(Math.max(this.leastTop, ...shown));
    const left = 34 * ratio;
    const y = (value: number) => h - 3 * ratio - (value / top) * (h - 9 * ratio);

    c.font = `${10 * ratio}px system-ui, sans-serif`;
    c.textAlign = "right";
    c.textBaseline = "middle";
    c.lineWidth = ratio;
    for (const value of [0, top / 2, top]) {
      c.strokeStyle = themeColour("--line");
      c.beginPath();
      c.moveTo(left, Math.round(y(value)) + 0.5);
      c.lineTo(w, Math.round(y(value)) + 0.5);
      c.stroke();
      c.fillStyle = themeColour("--muted");
      c.fillText(short(value), left - 4 * ratio, Math.min(h - 6 * ratio, Math.max(6 * ratio, y(value))));
    }
    if (this.band) {
      const [low, high] = this.band.map((value) => y(Math.min(value, top))) as [number, number];
      c.save();
      c.globalAlpha = 0.18;
      c.fillStyle = themeColour("--good");
      c.fillRect(left, high, w - left, low - high);
      c.restore();
    }
    if (this.limit !== null) {
      c.strokeStyle = themeColour("--limit");
      c.setLineDash([5 * ratio, 3 * ratio]);
      c.beginPath();
      c.moveTo(left, y(this.limit));
      c.lineTo(w, y(this.limit));
      c.stroke();
      c.setLineDash([]);
    }
    const last = this.times.at(-1) ?? 0;
    const x = (time: number) => left + (1 - (last - time) / this.span_s) * (w - left);
    for (const { colour, samples } of this.curves) {
      c.strokeStyle = themeColour(colour);
      c.lineWidth = 1.4 * ratio;
      c.lineJoin = "round";
      c.beginPath();
      let isDown = false;
      samples.forEach((value, i) => {
        if (!Number.isFinite(value) || this.times[i]! < last - this.span_s) return void (isDown = false);
        if (isDown) c.lineTo(x(this.times[i]!), y(value));
        else c.moveTo(x(this.times[i]!), y(value));
        isDown = true;
      });
      c.stroke();
    }
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const { time, text, colour } of this.marks) {
      c.fillStyle = themeColour(colour);
      c.fillText(text, Math.min(w - 5 * ratio, Math.max(left + 4 * ratio, x(time))), ratio);
    }
  }
}

function niceTop(value: number): number {
  const power = 10 ** Math.floor(Math.log10(value));
  return power * [1, 1.5, 2, 3, 4, 5, 6, 8, 10].find((step) => step * power >= value - 1e-9)!;
}
const short = (value: number): string =>
  value >= 1000 ? `${Number((value / 1000).toFixed(2))}k` : String(Number(value.toPrecision(3)));
