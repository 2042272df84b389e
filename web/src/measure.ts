// Ruler and angle: points of the patient, so that a measure stays where it was made when the picture moves.

import { angleAt_deg, length, sub, type Vec3 } from "./geometry.js";
import { text, type Frame } from "./overlay.js";

export interface Measure { kind: "ruler" | "angle"; points: Vec3[] }

export const isWhole = (measure: Measure): boolean => measure.points.length === (measure.kind === "ruler" ? 2 : 3);

/** An angle's corner is its second point. */
export function measureText({ kind, points }: Measure): string {
  if (kind === "ruler") return points.length < 2 ? "" : `${length(sub(points[1]!, points[0]!)).toFixed(1)} mm`;
  return points.length < 3 ? "" : `${angleAt_deg(points[1]!, points[0]!, points[2]!).toFixed(1)}°`;
}

/** @param farness_mm  from the picture's plane: a measure of another slice is faint */
export function drawMeasure(frame: Frame, measure: Measure, pixel: (p: Vec3) => [number, number], farness_mm: (p: Vec3) => number): void {
  const { context, ratio } = frame;
  const far = Math.max(...measure.points.map(farness_mm));
  if (far > 12) return;
  const at = measure.points.map(pixel);
  context.save();
  context.globalAlpha = far > 1.5 ? 0.35 : 1;
  for (const [thick, colour] of [[3.5, "rgba(6, 9, 11, 0.8)"], [1.4, "#8ee28a"]] as const) {
    context.lineWidth = thick * ratio;
    context.strokeStyle = colour;
    context.beginPath();
    at.forEach(([x, y], i) => (i === 0 ? context.moveTo(x, y) : context.lineTo(x, y)));
    context.stroke();
    for (const [x, y] of at) {
      context.beginPath();
      context.arc(x, y, 3 * ratio, 0, 2 * Math.PI);
      context.stroke();
    }
  }
  const words = measureText(measure);
  const [x, y] = measure.kind === "angle" ? at[1]! : at.at(-1)!;
  if (words) text(frame, words, x + 8 * ratio, y - 8 * ratio, 12, "#8ee28a", "left", "bottom");
  context.restore();
}
