// Overlays of no-go regions: planes and balls, which have no voxels, with a dashed line at the margin where they begin
// to push; while a region pushes, a border around the picture and a text. Colour is never the only cue.

import { quantity } from "../words/figures.js";
import { add, tangents, dot, length, normalOf, scale, sub, type Plane, type Vec3 } from "../base/geometry.js";
import { boxSection, drawLine, type InVolume } from "./in_volume.js";
import { line, ring, text, type Frame } from "./overlay.js";
import type { Volumes } from "../protocol/scene.js";
import type { Session } from "../state/session.js";
import { words } from "../words/words.js";

export const NO_GO = "#ff8d7c";
const SHADE = "rgba(6, 9, 11, 0.7)";
/** Spacing and length of hatching strokes; CSS pixels. */
const HATCH_APART = 14,
  HATCH_LONG = 8;
const RIM = 5;
/** Number of segments of a circle's polygon in the volume. */
const PARTS = 32;

const twice = (draw: (thick: number, colour: string) => void): void => {
  draw(4, SHADE);
  draw(1.8, NO_GO);
};

interface OnPlane {
  plane: Plane;
  pixel(p: Vec3): [number, number];
  mmPerPixel: number; /* mm per canvas pixel */
}

/** Draws the intersection of a region's plane with a picture's plane, across the whole picture. */
function drawBorder(
  frame: Frame,
  { plane, pixel, mmPerPixel }: OnPlane,
  point: Vec3,
  outward: Vec3,
  isWhereItPushes: boolean,
): void {
  const normal = normalOf(plane);
  // direction to the permitted side, projected onto the picture's plane
  const free = sub(outward, scale(normal, dot(outward, normal)));
  const size = length(free);
  // parallel planes do not intersect
  if (size < 1e-3) return;
  const direction = scale(free, 1 / size);
  const on = add(plane.centre, scale(direction, dot(sub(point, plane.centre), outward) / size));
  const far_mm = Math.hypot(frame.width, frame.height) * mmPerPixel;
  if (length(sub(on, plane.centre)) > far_mm) return;
  const along: Vec3 = [
    direction[1] * normal[2] - direction[2] * normal[1],
    direction[2] * normal[0] - direction[0] * normal[2],
    direction[0] * normal[1] - direction[1] * normal[0],
  ];
  const at = (mm: number, back_mm = 0): [number, number] =>
    pixel(add(on, add(scale(along, mm), scale(direction, -back_mm))));
  if (isWhereItPushes) return line(frame, at(-far_mm), at(far_mm), 1.4, NO_GO, [5, 5]);
  twice((thick, colour) => line(frame, at(-far_mm), at(far_mm), thick, colour));
  // hatching on the forbidden side
  const apart_mm = HATCH_APART * frame.ratio * mmPerPixel,
    long_mm = HATCH_LONG * frame.ratio * mmPerPixel;
  for (let mm = -far_mm; mm < far_mm; mm += apart_mm) line(frame, at(mm), at(mm - long_mm, long_mm), 1, NO_GO);
}

/** Draws the intersections of planes and balls with a section. */
export function drawNoGoOnPlane(frame: Frame, session: Session, on: OnPlane): void {
  for (const { plane, ball, keep_away_mm } of session.scene.value!.no_go) {
    if (plane) {
      drawBorder(frame, on, plane.point_mm, plane.outward, false);
      if (keep_away_mm > 0)
        drawBorder(frame, on, add(plane.point_mm, scale(plane.outward, keep_away_mm)), plane.outward, true);
    }
    if (!ball) continue;
    const off_mm = dot(sub(ball.centre_mm, on.plane.centre), normalOf(on.plane));
    const radiusAt = (mm: number) => Math.sqrt(Math.max(0, mm * mm - off_mm * off_mm)) / on.mmPerPixel;
    const at = on.pixel(ball.centre_mm);
    const [own, pushes] = [radiusAt(ball.radius_mm), radiusAt(ball.radius_mm + keep_away_mm)];
    if (own > 0) {
      twice((thick, colour) => ring(frame, at, own, thick, colour));
      hatchDisc(frame, at, own);
    }
    if (keep_away_mm > 0 && pushes > 0) ring(frame, at, pushes, 1.4, NO_GO, [5, 5]);
  }
}

function hatchDisc(frame: Frame, [x, y]: [number, number], radius: number): void {
  const { context, ratio } = frame;
  context.save();
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.clip();
  context.globalAlpha *= 0.6;
  // hatching along lines of constant x + y that cross both disc and picture
  const reach = Math.SQRT2 * radius,
    step = HATCH_APART * ratio;
  const last = Math.min(frame.width + frame.height, x + y + reach);
  for (let sum = Math.max(0, x + y - reach); sum < last; sum += step)
    line(frame, [sum, 0], [sum - frame.height, frame.height], 1, NO_GO);
  context.restore();
}

/** Draws the intersection of planes with the volume's bounding box, and balls as three great circles. */
export function drawNoGoInVolume(frame: Frame, projection: InVolume, session: Session, volumes: Volumes): void {
  for (const { plane, ball } of session.scene.value!.no_go) {
    if (plane) {
      const [right, down] = tangents(plane.outward);
      const corners = boxSection({ centre: plane.point_mm, right, down }, volumes);
      corners.forEach((corner, n) =>
        drawLine(frame, projection, corner, corners[(n + 1) % corners.length]!, 1.8, NO_GO, 1),
      );
      // short strokes on the forbidden side
      corners.forEach((corner) =>
        drawLine(frame, projection, corner, add(corner, scale(plane.outward, -0.03 * volumes.size)), 1.8, NO_GO, 1),
      );
    }
    if (!ball) continue;
    const axes: [Vec3, Vec3][] = [
      [
        [1, 0, 0],
        [0, 1, 0],
      ],
      [
        [0, 1, 0],
        [0, 0, 1],
      ],
      [
        [0, 0, 1],
        [1, 0, 0],
      ],
    ];
    for (const [a, b] of axes) {
      const at = (n: number) => {
        const angle = (2 * Math.PI * n) / PARTS;
        return add(ball.centre_mm, scale(add(scale(a, Math.cos(angle)), scale(b, Math.sin(angle))), ball.radius_mm));
      };
      for (let n = 0; n < PARTS; n++) drawLine(frame, projection, at(n), at(n + 1), 1.5, NO_GO, 1);
    }
  }
}

/**
 * Draws a warning while a region pushes the tool out: a border, the region's name and the penetration depth.
 * @param top  vertical position of the text, CSS pixels
 */
export function drawNoGoWarning(frame: Frame, session: Session, top: number): void {
  const pushing = session.pushing.value;
  if (!pushing) return;
  const { context, width, height, ratio } = frame;
  const rim = RIM * ratio;
  context.save();
  context.lineWidth = rim;
  context.strokeStyle = session.isFresh.value ? NO_GO : "#a4adb3";
  context.setLineDash([18 * ratio, 8 * ratio]);
  context.strokeRect(rim / 2, rim / 2, width - rim, height - rim);
  context.restore();
  text(
    frame,
    `⚠ ${words.tooNear(session.regionName(pushing.region), quantity(-pushing.mm, "mm"))}`,
    12 * ratio,
    top * ratio,
    13,
    session.isFresh.value ? NO_GO : "#a4adb3",
    "left",
    "top",
    700,
  );
}
