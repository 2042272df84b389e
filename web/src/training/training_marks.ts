// Overlays of a task in the volume: target region, path of the tip, coverage of a surface. Colour is never the only
// cue: covered patches are filled, others are rings.

import type { Debriefing, TaskForce, TaskRegion } from "../protocol/messages.js";
import type { Vec3 } from "../base/geometry.js";
import { line, ring, text, type Frame } from "../drawing/overlay.js";
import type { InVolume } from "../drawing/in_volume.js";

const REGION = "#ffe07a";
const WAY = "#8adcf0",
  PRESSED = "#ffd34d",
  TOO_MUCH = "#ff6b5e";
const COVERED = "rgba(126, 217, 87, 0.85)",
  OPEN = "rgba(255, 196, 92, 0.9)";
/** Depth tolerance with which a path on a surface counts as visible. */
const SLACK_MM = 1.5;
const MIN_FORCE_N = 0.05;

/** Draws a region of a task: a ring with the region's radius, and its name. */
export function drawRegion(frame: Frame, projection: InVolume, region: TaskRegion, name: string): void {
  const at = projection.pixel(region.middle_mm);
  const radius = Math.max(
    10 * frame.ratio,
    Math.min(region.radius_mm * projection.pixelsPerMm(region.middle_mm), 0.45 * Math.min(frame.width, frame.height)),
  );
  ring(frame, at, radius, 4, "rgba(6, 9, 11, 0.7)", [7, 6]);
  ring(frame, at, radius, 1.8, REGION, [7, 6]);
  text(frame, name, at[0], at[1] - radius - 5 * frame.ratio, 12, REGION, "center", "bottom");
}

/** Contact level of a sample: 0 none, 1 contact, 2 above a limit. */
function hardness(sample: number[], forces: TaskForce[]): number {
  const isOver = forces.some(({ limit_N }, n) => limit_N !== null && (sample[5 + n] ?? 0) > limit_N);
  return isOver ? 2 : sample[4]! > MIN_FORCE_N ? 1 : 0;
}
const hasPosition = (sample: number[]): boolean => sample.slice(1, 4).every((x) => x !== null && Number.isFinite(x));

/** Draws the tip's path: thin in free space, thick in contact, thicker above a limit; dashed where occluded. */
export function drawPath(frame: Frame, projection: InVolume, { samples }: Debriefing, forces: TaskForce[]): void {
  let before: number[] | null = null;
  for (const sample of samples) {
    if (!hasPosition(sample)) {
      before = null;
      continue;
    }
    if (before) {
      const to = sample.slice(1, 4) as Vec3;
      const isHidden = projection.hides(to, SLACK_MM);
      const hard = hardness(sample, forces);
      frame.context.save();
      if (isHidden) frame.context.globalAlpha = 0.4;
      line(
        frame,
        projection.pixel(before.slice(1, 4) as Vec3),
        projection.pixel(to),
        [1.2, 2.4, 4][hard]!,
        [WAY, PRESSED, TOO_MUCH][hard]!,
        isHidden ? [2, 3] : [],
      );
      frame.context.restore();
    }
    before = sample;
  }
}

export function drawPatches(frame: Frame, projection: InVolume, { patches }: Debriefing): void {
  const { context, ratio } = frame;
  const open = new Path2D();
  for (const [x, y, z, isCovered] of patches) {
    const p: Vec3 = [x, y, z];
    if (projection.hides(p, SLACK_MM)) continue;
    const [px, py] = projection.pixel(p);
    const side = Math.max(2 * ratio, 0.8 * projection.pixelsPerMm(p));
    if (isCovered) {
      context.fillStyle = COVERED;
      context.fillRect(px - side / 2, py - side / 2, side, side);
    } else {
      const radius = Math.min(side / 3, 3 * ratio);
      open.moveTo(px + radius, py);
      open.arc(px, py, radius, 0, 2 * Math.PI);
    }
  }
  context.strokeStyle = OPEN;
  context.lineWidth = ratio;
  context.stroke(open);
}

/** Draws a cross with a name, at the answer or at the structure to be found. */
export function drawPosition(frame: Frame, projection: InVolume, p: Vec3, name: string, isTrue: boolean): void {
  const [x, y] = projection.pixel(p);
  const half = 8 * frame.ratio;
  const colour = isTrue ? "#7ed957" : REGION;
  for (const [thick, stroke] of [
    [5, "rgba(6, 9, 11, 0.8)"],
    [2.4, colour],
  ] as const) {
    if (isTrue) ring(frame, [x, y], half, thick, stroke);
    else {
      line(frame, [x - half, y - half], [x + half, y + half], thick, stroke);
      line(frame, [x - half, y + half], [x + half, y - half], thick, stroke);
    }
  }
  text(frame, name, x + half + 5 * frame.ratio, y, 12, colour, "left", "middle");
}
