// How strained tissue is shown in sections: colours, and what they stand for.

import type { Rgb } from "./scene.js";
import { text, type Frame } from "./overlay.js";

import { words } from "./words.js";

/** From none to MOST_STRAIN, evenly: dark is little, in greys too ("inferno" of matplotlib). */
export const STRAIN_COLOURS: Rgb[] = [[0, 0, 4], [87, 16, 110], [188, 55, 84], [249, 142, 9], [252, 255, 164]];
/** What is strained more looks the same; what is strained less than LEAST_STRAIN is covered the less. */
export const MOST_STRAIN = 0.25, LEAST_STRAIN = 0.02;

/** What the colours stand for, at the lower left above the scale. @param yields  whether there is anything to be seen of it */
export function drawStrainLegend(frame: Frame, yields: boolean): void {
  const { context, height, ratio } = frame;
  const [long, thick] = [120 * ratio, 10 * ratio];
  const [x, y] = [12 * ratio, height - 66 * ratio];
  text(frame, yields ? words.strainLegend : words.strainNone, x, y - 6 * ratio, 12, "#eef3f5", "left", "bottom");
  const colours = context.createLinearGradient(x, 0, x + long, 0);
  STRAIN_COLOURS.forEach((rgb, n) => colours.addColorStop(n / (STRAIN_COLOURS.length - 1), `rgb(${rgb.join(" ")})`));
  context.fillStyle = "#eef3f5";
  context.fillRect(x - ratio, y - ratio, long + 2 * ratio, thick + 2 * ratio);
  context.fillStyle = colours;
  context.fillRect(x, y, long, thick);
  const most = 100 * MOST_STRAIN;
  text(frame, "0", x, y + thick + 4 * ratio, 11, "#eef3f5", "left", "top");
  text(frame, `≥ ${most} %`, x + long, y + thick + 4 * ratio, 11, "#eef3f5", "right", "top");
}
