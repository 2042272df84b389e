// Rulers and angles, by points in the patient frame, independent of the view.

import { quantity } from "../words/figures.js";
import { angleAt_deg, length, sub, type Vec3, type PlaneKind } from "../base/geometry.js";
import { text, type Frame } from "./overlay.js";
import { words } from "../words/words.js";

export interface Measure {
  kind: "ruler" | "angle";
  points: Vec3[];
  name: string;
  plane: PlaneKind; // section in which it was made
  normal: Vec3;
  slice: number; // slice number in that section
}

export const isWhole = (measure: Pick<Measure, "kind" | "points">): boolean =>
  measure.points.length === (measure.kind === "ruler" ? 2 : 3);

/** Value of a measure with unit; the second point of an angle is its vertex. */
export function measureText({ kind, points }: Pick<Measure, "kind" | "points">): string {
  if (kind === "ruler") return points.length < 2 ? "" : quantity(length(sub(points[1]!, points[0]!)), "mm");
  const [a, corner, b] = points;
  // an angle is undefined while an arm has zero length
  if (!a || !corner || !b || length(sub(a, corner)) === 0 || length(sub(b, corner)) === 0) return "";
  return `${angleAt_deg(corner, a, b).toFixed(1)}°`;
}

/** Maximum distance from the section at which a measure is drawn. */
const MAX_DISTANCE_MM = 12;

/**
 * Appearance of a measure at a distance from the section's plane; null if it is not drawn.
 * @param within_mm  distance up to which it counts as lying in the plane
 */
export function shownAt(far_mm: number, within_mm: number): { strength: number; off: string } | null {
  if (far_mm <= within_mm) return { strength: 1, off: "" };
  if (far_mm > MAX_DISTANCE_MM) return null;
  return { strength: 0.45 - (0.3 * far_mm) / MAX_DISTANCE_MM, off: ` · ${words.offThisPlane(quantity(far_mm, "mm"))}` };
}

/** @param distance_mm  distance of a point from the section's plane */
export function drawMeasure(
  frame: Frame,
  measure: Pick<Measure, "kind" | "points">,
  within_mm: number,
  pixel: (p: Vec3) => [number, number],
  distance_mm: (p: Vec3) => number,
): void {
  const { context, ratio } = frame;
  const shown = shownAt(Math.max(...measure.points.map(distance_mm)), within_mm);
  if (!shown) return;
  const at = measure.points.map(pixel);
  context.save();
  context.globalAlpha = shown.strength;
  context.setLineDash(shown.off ? [4 * ratio, 4 * ratio] : []);
  for (const [thick, colour] of [
    [3.5, "rgba(6, 9, 11, 0.8)"],
    [1.4, "#8ee28a"],
  ] as const) {
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
  const figure = measureText(measure);
  const [x, y] = measure.kind === "angle" ? at[1]! : at.at(-1)!;
  if (figure) text(frame, figure + shown.off, x + 8 * ratio, y - 8 * ratio, 12, "#8ee28a", "left", "bottom");
  context.restore();
}

/** Table of measures, CSV (RFC 4180); points in LPS, mm: two for a ruler, three for an angle. */
export function measuresTable(measures: readonly Measure[]): string {
  const quoted = (name: string) => `"${name.replaceAll('"', '""')}"`;
  const axes = [1, 2, 3].flatMap((n) => ["x", "y", "z"].map((axis) => `${axis}${n}_lps_mm`));
  const rows = measures.map(({ kind, points, name, plane, slice }) => {
    const [a, b, c] = points as [Vec3, Vec3, Vec3?];
    const figures = c ? ["", angleAt_deg(b, a, c).toFixed(2)] : [length(sub(b, a)).toFixed(3), ""];
    return [
      quoted(name),
      kind,
      plane,
      slice,
      ...figures,
      ...[a, b, c].flatMap((p) => (p ?? ["", "", ""]).map((x) => (x === "" ? "" : Number(x).toFixed(3)))),
    ];
  });
  return [["name", "kind", "plane", "slice", "length_mm", "angle_deg", ...axes], ...rows]
    .map((row) => `${row.join(",")}\r\n`)
    .join("");
}
