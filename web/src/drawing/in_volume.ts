// Overlays on a picture of the volume, positioned in 3-D and dashed where a solid surface occludes them.

import { quantity } from "../words/figures.js";
import { add, apply, tangents, dot, length, normalOf, scale, sub, type Plane, type Vec3 } from "../base/geometry.js";
import { drawRod } from "./instrument.js";
import { line, text, type Frame } from "./overlay.js";
import type { Volumes } from "../protocol/scene.js";

export interface InVolume {
  pixel(p: Vec3): [number, number]; // canvas pixels
  pixelsPerMm(p: Vec3): number;
  /** Whether a solid surface is more than `slack_mm` in front of a position. */
  hides(p: Vec3, slack_mm: number): boolean;
}

/** Alternating visible and occluded intervals of a straight line, in order. */
export function runs(
  a: Vec3,
  b: Vec3,
  pieces: number,
  isHidden: (p: Vec3) => boolean,
): { from: Vec3; to: Vec3; isHidden: boolean }[] {
  const at = (n: number) => add(a, scale(sub(b, a), n / pieces));
  const found: { from: Vec3; to: Vec3; isHidden: boolean }[] = [];
  for (let n = 0; n < pieces; n++) {
    const hidden = isHidden(at(n + 0.5));
    const before = found.at(-1);
    if (before?.isHidden === hidden) before.to = at(n + 1);
    else found.push({ from: at(n), to: at(n + 1), isHidden: hidden });
  }
  return found;
}
/** Number of samples of a line: one per six CSS pixels. */
const piecesOf = (frame: Frame, a: [number, number], b: [number, number]): number =>
  Math.min(80, Math.max(1, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1]) / (6 * frame.ratio))));

export function drawLine(
  frame: Frame,
  projection: InVolume,
  a: Vec3,
  b: Vec3,
  thick: number,
  colour: string,
  slack_mm: number,
  dash: number[] = [],
): void {
  const { context } = frame;
  for (const run of runs(a, b, piecesOf(frame, projection.pixel(a), projection.pixel(b)), (p) =>
    projection.hides(p, slack_mm),
  )) {
    context.save();
    if (run.isHidden) context.globalAlpha *= 0.5;
    line(frame, projection.pixel(run.from), projection.pixel(run.to), thick, colour, run.isHidden ? [3, 5] : dash);
    context.restore();
  }
}

/** Outline of a capsule of the tool: filled where visible, dashed where occluded. */
export function drawShaft(
  frame: Frame,
  projection: InVolume,
  from: Vec3,
  to: Vec3,
  radii_mm: readonly [number, number],
  colour: string,
  slack_mm: number,
): void {
  const { context, ratio } = frame;
  const long = length(sub(to, from));
  const radiusAt = (p: Vec3): number =>
    radii_mm[0] + (radii_mm[1] - radii_mm[0]) * (long > 0 ? length(sub(p, from)) / long : 0);
  for (const run of runs(from, to, piecesOf(frame, projection.pixel(from), projection.pixel(to)), (p) =>
    projection.hides(p, slack_mm + radiusAt(p)),
  )) {
    const [a, b] = [projection.pixel(run.from), projection.pixel(run.to)];
    const towards = Math.atan2(b[1] - a[1], b[0] - a[0]) + Math.PI / 2;
    const side = (at: [number, number], p: Vec3, sign: number): [number, number] => {
      const wide = sign * Math.max(1.5 * ratio, radiusAt(p) * projection.pixelsPerMm(p));
      return [at[0] + wide * Math.cos(towards), at[1] + wide * Math.sin(towards)];
    };
    const [left, right] = [1, -1].map((sign) => [side(a, run.from, sign), side(b, run.to, sign)] as const) as [
      readonly [[number, number], [number, number]],
      readonly [[number, number], [number, number]],
    ];
    context.save();
    // dashed where occluded
    context.globalAlpha = run.isHidden ? 0.6 : 1;
    if (!run.isHidden) {
      const wide = (p: Vec3) => Math.max(1.5 * ratio, radiusAt(p) * projection.pixelsPerMm(p));
      drawRod(context, a, b, [wide(run.from), wide(run.to)]);
    }
    for (const [begin, end] of [left, right]) {
      if (!run.isHidden) line(frame, begin, end, 3, "rgba(6, 9, 11, 0.6)");
      line(frame, begin, end, 1.3, colour, run.isHidden ? [3, 4] : []);
    }
    // round ends
    for (const [end, at, phase] of [
      [from, run.from, 0],
      [to, run.to, Math.PI],
    ] as const) {
      if (end.some((x, i) => Math.abs(x - at[i]!) > 1e-9)) continue;
      const [x, y] = projection.pixel(end);
      context.setLineDash(run.isHidden ? [3 * ratio, 4 * ratio] : []);
      context.beginPath();
      context.arc(
        x,
        y,
        Math.max(1.5 * ratio, radiusAt(end) * projection.pixelsPerMm(end)),
        towards + phase,
        towards + phase + Math.PI,
      );
      context.lineWidth = 1.3 * ratio;
      context.strokeStyle = colour;
      context.stroke();
    }
    context.restore();
  }
}

/** Draws the height of a tool: a line down to the nearest surface with contact below, and a shadow on the latter. */
export function drawHeight(
  frame: Frame,
  projection: InVolume,
  tool: Vec3,
  ground: { foot: Vec3; height_mm: number },
  radius_mm: number,
): void {
  const { context, ratio } = frame;
  const { foot, height_mm } = ground;
  const colour = "rgba(238, 243, 245, 0.8)";
  const up = scale(sub(tool, foot), 1 / height_mm);
  // shadow: a disc orthogonal to the line
  const [aside, forward] = tangents(up);
  const size = Math.max(1.2, radius_mm);
  context.save();
  context.beginPath();
  for (let n = 0; n < 24; n++) {
    const angle = (n * Math.PI) / 12;
    context.lineTo(
      ...projection.pixel(add(foot, add(scale(aside, size * Math.cos(angle)), scale(forward, size * Math.sin(angle))))),
    );
  }
  context.closePath();
  context.globalAlpha = projection.hides(foot, 2) ? 0.3 : 0.65;
  context.fillStyle = "#06090b";
  context.fill();
  context.lineWidth = ratio;
  context.strokeStyle = colour;
  context.stroke();
  context.restore();
  drawLine(frame, projection, tool, foot, 1.2, colour, 2, [2, 2]);
  const [a, b] = [projection.pixel(tool), projection.pixel(foot)];
  if (Math.hypot(a[0] - b[0], a[1] - b[1]) > 16 * ratio)
    text(
      frame,
      quantity(height_mm, "mm"),
      (a[0] + b[0]) / 2 + 6 * ratio,
      (a[1] + b[1]) / 2,
      11,
      "#eef3f5",
      "left",
      "middle",
    );
}

/** Corners, in order, of the polygon in which a plane intersects the volume's bounding box; empty: no intersection. */
export function boxSection(plane: Plane, volumes: Volumes): Vec3[] {
  const normal = normalOf(plane);
  const corners = Array.from({ length: 8 }, (_, n) =>
    apply(volumes.patientFromVoxel, volumes.dims.map((size, axis) => ((n >> axis) & 1 ? size - 0.5 : -0.5)) as Vec3),
  );
  const met: Vec3[] = [];
  for (let n = 0; n < 8; n++) {
    for (const axis of [1, 2, 4]) {
      if (n & axis) continue;
      const [a, b] = [corners[n]!, corners[n | axis]!];
      const [from, to] = [dot(sub(a, plane.centre), normal), dot(sub(b, plane.centre), normal)];
      if (from < 0 === to < 0) continue;
      met.push(add(a, scale(sub(b, a), from / (from - to))));
    }
  }
  const middle = scale(met.reduce(add, [0, 0, 0]), 1 / (met.length || 1));
  const angle = (p: Vec3) => Math.atan2(dot(sub(p, middle), plane.down), dot(sub(p, middle), plane.right));
  return met.sort((p, q) => angle(p) - angle(q));
}
export function drawPlane(frame: Frame, projection: InVolume, corners: Vec3[], colour: string): void {
  corners.forEach((corner, n) =>
    drawLine(frame, projection, corner, corners[(n + 1) % corners.length]!, 1.6, colour, 1),
  );
}
