// Colours of strain in sections, and their legend.

import type { Rgb } from "../protocol/messages.js";
import { text, type Frame } from "./overlay.js";

import { words } from "../words/words.js";

/** Colours from zero to MAX_STRAIN in equal steps, of increasing luminance ("inferno" of matplotlib). */
export const STRAIN_COLOURS: Rgb[] = [
  [0, 0, 4],
  [87, 16, 110],
  [188, 55, 84],
  [249, 142, 9],
  [252, 255, 164],
];
/** Strain to which the colours are clamped, and strain below which they fade out. */
export const MAX_STRAIN = 0.25,
  MIN_STRAIN = 0.02;

/**
 * Draws the legend of the colours, at the lower left above the scale bar.
 * @param isDeformed  whether any tissue is deformable
 */
export function drawStrainLegend(frame: Frame, isDeformed: boolean): void {
  const { context, height, ratio } = frame;
  const [long, thick] = [120 * ratio, 10 * ratio];
  const [x, y] = [12 * ratio, height - 66 * ratio];
  text(frame, isDeformed ? words.strainLegend : words.strainNone, x, y - 6 * ratio, 12, "#eef3f5", "left", "bottom");
  const colours = context.createLinearGradient(x, 0, x + long, 0);
  STRAIN_COLOURS.forEach((rgb, n) => colours.addColorStop(n / (STRAIN_COLOURS.length - 1), `rgb(${rgb.join(" ")})`));
  context.fillStyle = "#eef3f5";
  context.fillRect(x - ratio, y - ratio, long + 2 * ratio, thick + 2 * ratio);
  context.fillStyle = colours;
  context.fillRect(x, y, long, thick);
  const most = 100 * MAX_STRAIN;
  text(frame, "0", x, y + thick + 4 * ratio, 11, "#eef3f5", "left", "top");
  text(frame, `≥ ${most} %`, x + long, y + thick + 4 * ratio, 11, "#eef3f5", "right", "top");
}
