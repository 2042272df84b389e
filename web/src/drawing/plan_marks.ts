// Overlays of trajectories. Sections: solid within the plane, dashed elsewhere, a ring at the intersection with the
// plane. Volume: dashed where occluded. Entries are rings, targets crosses.

import type { Trajectory } from "../protocol/messages.js";
import { add, dot, normalOf, scale, sub, type Plane, type Vec3 } from "../base/geometry.js";
import { drawLine, type InVolume } from "./in_volume.js";
import { line, ring, text, type Frame } from "./overlay.js";
import type { PlanStore } from "../state/plan_store.js";

const PLANNED = "#b7f58a",
  CHOSEN = "#ffffff";
const SHADE = "rgba(6, 9, 11, 0.75)";
/** Distance from a section's plane up to which a point counts as lying in it. */
const IN_PLANE_MM = 1;
/** Maximum distance from a section's plane at which a trajectory is drawn. */
const MAX_DISTANCE_MM = 40;
const MARK = 6;

function drawEnds(
  frame: Frame,
  { name, entry_mm, target_mm }: Trajectory,
  pixel: (p: Vec3) => [number, number],
  clearness: (p: Vec3) => number,
  colour: string,
): void {
  const { context, ratio } = frame;
  const half = MARK * ratio;
  for (const [thick, stroke] of [
    [4.5, SHADE],
    [2, colour],
  ] as const) {
    context.save();
    context.globalAlpha *= clearness(entry_mm);
    ring(frame, pixel(entry_mm), half, thick, stroke);
    context.restore();
    context.save();
    context.globalAlpha *= clearness(target_mm);
    const [x, y] = pixel(target_mm);
    line(frame, [x - half, y - half], [x + half, y + half], thick, stroke);
    line(frame, [x - half, y + half], [x + half, y - half], thick, stroke);
    context.restore();
  }
  const [x, y] = pixel(entry_mm);
  text(frame, name, x + half + 4 * ratio, y, 12, colour, "left", "middle");
}

export function drawPlanOnPlane(
  frame: Frame,
  { drawn, chosen }: PlanStore,
  plane: Plane,
  pixel: (p: Vec3) => [number, number],
): void {
  const normal = normalOf(plane);
  const off = (p: Vec3) => dot(sub(p, plane.centre), normal);
  drawn.forEach((trajectory, index) => {
    const { entry_mm, target_mm } = trajectory;
    const [from, to] = [off(entry_mm), off(target_mm)];
    const meets = from < 0 !== to < 0;
    if (!meets && Math.min(Math.abs(from), Math.abs(to)) > MAX_DISTANCE_MM) return;
    const colour = index === chosen.value ? CHOSEN : PLANNED;
    const at = (fraction: number) => add(entry_mm, scale(sub(target_mm, entry_mm), fraction));
    // interval of the trajectory within IN_PLANE_MM of the plane
    const shareAt = (mm: number) => Math.min(1, Math.max(0, (mm - from) / (to - from)));
    const isAlong = Math.abs(to - from) < 1e-6;
    const isIn = Math.abs(from) <= IN_PLANE_MM;
    const [begin, end] = isAlong
      ? [isIn ? 0 : 1, 1]
      : ([shareAt(-IN_PLANE_MM), shareAt(IN_PLANE_MM)].sort((a, b) => a - b) as [number, number]);
    line(frame, pixel(entry_mm), pixel(target_mm), 3.5, SHADE);
    line(frame, pixel(entry_mm), pixel(target_mm), 1.4, colour, [4, 5]);
    if (end > begin) line(frame, pixel(at(begin)), pixel(at(end)), 2.6, colour);
    if (meets)
      for (const [thick, stroke] of [
        [4.5, SHADE],
        [2, colour],
      ] as const)
        ring(frame, pixel(at(from / (from - to))), 3.5 * frame.ratio, thick, stroke);
    drawEnds(frame, trajectory, pixel, (p) => Math.max(0.35, 1 - Math.abs(off(p)) / 12), colour);
  });
}

export function drawPlanInVolume(frame: Frame, projection: InVolume, { drawn, chosen }: PlanStore): void {
  drawn.forEach((trajectory, index) => {
    const colour = index === chosen.value ? CHOSEN : PLANNED;
    drawLine(frame, projection, trajectory.entry_mm, trajectory.target_mm, 2, colour, 1);
    drawEnds(frame, trajectory, projection.pixel, (p) => (projection.hides(p, 1) ? 0.55 : 1), colour);
  });
}
