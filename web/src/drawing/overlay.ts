// Overlays shared by all pictures: orientation letters, scale bar, side mark, tool and force. Sizes are in CSS pixels;
// `ratio` is the number of canvas pixels per CSS pixel.

import type { Scene } from "../protocol/messages.js";
import { drawContactShadow, drawInstrument } from "./instrument.js";
import { limitQuantity, quantity } from "../words/figures.js";
import { add, length, niceLength, rotate, scale, type Letters, type Vec3 } from "../base/geometry.js";
import type { Session } from "../state/session.js";
import { Flag, type DevicePose } from "../protocol/wire.js";
import { words } from "../words/words.js";

export const FONT = 'system-ui, "Segoe UI", Roboto, "Helvetica Neue", "Liberation Sans", Arial, sans-serif';
const TOOL = "#4fd8ee";
const FORCE = "#ffd34d";
const GREY = "#a4adb3";
/** Threshold below which a force is a rounding error without meaningful direction. */
const MIN_FORCE_N = 1e-5;
/** Minimum radius from which the size of a contact shadow follows; a point tool has none. */
const MIN_SHADOW_MM = 1.2;

export interface Frame {
  context: CanvasRenderingContext2D;
  width: number;
  height: number;
  ratio: number;
}

/** Draws text with an outline, legible on any background. */
export function text(
  frame: Frame,
  said: string,
  x: number,
  y: number,
  size: number,
  colour: string,
  align: CanvasTextAlign = "left",
  baseline: CanvasTextBaseline = "alphabetic",
  weight = 600,
): void {
  const { context, ratio } = frame;
  context.font = `${weight} ${size * ratio}px ${FONT}`;
  context.textAlign = align;
  context.textBaseline = baseline;
  context.lineJoin = "round";
  context.lineWidth = 3 * ratio;
  context.strokeStyle = "rgba(6, 9, 11, 0.85)";
  context.strokeText(said, x, y);
  context.fillStyle = colour;
  context.fillText(said, x, y);
}

/**
 * Draws orientation letters at the four edges.
 * @param hasControls  the picture's head has controls, which reach the middle of a narrow picture
 * @param slider  width of the slider at the right edge; CSS pixels
 */
export function drawLetters(frame: Frame, letters: Letters, oriented: boolean, hasControls: boolean, slider = 0): void {
  const { width, height, ratio } = frame;
  const shown = oriented ? letters : { left: "?", right: "?", top: "?", bottom: "?" };
  const colour = oriented ? "#eef3f5" : "#f5c277";
  text(frame, shown.left, 9 * ratio, height / 2, 15, colour, "left", "middle");
  text(frame, shown.right, width - (9 + slider) * ratio, height / 2, 15, colour, "right", "middle");
  text(frame, shown.top, width / 2, (hasControls && width < 640 * ratio ? 36 : 8) * ratio, 15, colour, "center", "top");
  text(frame, shown.bottom, width / 2, height - 8 * ratio, 15, colour, "center", "bottom");
}

/**
 * Draws the side mark at the lower right, clear of the letters, and above it a warning if placement or side is
 * uncertain.
 * @param slider  width of the slider at the right edge, which ends above the lowest line; CSS pixels
 */
export function drawSide(frame: Frame, scene: Scene, slider = 0): void {
  const { width, height, ratio } = frame;
  const side = words.side[scene.side];
  const lines = [
    scene.side === "unknown" ? side : words.sideInPicture(side),
    ...doubts(scene).map((doubt) => words.caveats[doubt]),
  ];
  lines.forEach((line, n) => {
    const isWarning = n > 0 || scene.side === "unknown";
    text(
      frame,
      line,
      width - (10 + (n > 0 ? slider : 0)) * ratio,
      height - (10 + 16 * n) * ratio,
      12,
      isWarning ? "#f5c277" : "#eef3f5",
      "right",
      "bottom",
    );
  });
}
const doubts = (scene: Scene): ("side" | "placement")[] =>
  (["side", "placement"] as const).filter((doubt) => scene.caveats.some(({ concerns }) => concerns === doubt));

/** Draws the scale bar at the lower left. */
export function drawScale(frame: Frame, mmPerPixel: number): void {
  const { context, width, height, ratio } = frame;
  const mm = niceLength(mmPerPixel * Math.min(width / 3.2, 160 * ratio));
  const long = mm / mmPerPixel;
  const [x, y] = [12 * ratio, height - 12 * ratio];
  for (const [thick, colour] of [
    [4, "rgba(6, 9, 11, 0.85)"],
    [1.5, "#eef3f5"],
  ] as const) {
    context.lineWidth = thick * ratio;
    context.strokeStyle = colour;
    context.beginPath();
    context.moveTo(x, y - 5 * ratio);
    context.lineTo(x, y);
    context.lineTo(x + long, y);
    context.lineTo(x + long, y - 5 * ratio);
    context.stroke();
  }
  text(
    frame,
    mm >= 1 ? `${mm} mm` : `${Number((mm * 1000).toPrecision(2))} µm`,
    x + long + 7 * ratio,
    y + 2 * ratio,
    12,
    "#eef3f5",
    "left",
    "bottom",
  );
}

export interface Projection {
  pixel(p: Vec3): [number, number]; // canvas pixels
  direction(v: Vec3): [number, number]; // projection of a unit vector, patient frame: length at most 1, y down
  pixelsPerMm(p: Vec3): number;
  /** Opacity of overlays at a position, 0 to 1. */
  clearness(p: Vec3): number;
  /** The picture shows bodies, so that the tool is drawn as one; absent: a section, which shows its outline. */
  hasBodies?: boolean;
  /** Draws a capsule of the tool; absent: its outline in the plane is drawn. */
  capsule?(from: Vec3, to: Vec3, radii_mm: readonly [number, number], colour: string): void;
}

export function line(
  frame: Frame,
  from: [number, number],
  to: [number, number],
  thick: number,
  colour: string,
  dash: number[] = [],
): void {
  const { context, ratio } = frame;
  context.setLineDash(dash.map((d) => d * ratio));
  context.lineWidth = thick * ratio;
  context.strokeStyle = colour;
  context.beginPath();
  context.moveTo(...from);
  context.lineTo(...to);
  context.stroke();
  context.setLineDash([]);
}

export function ring(
  frame: Frame,
  at: [number, number],
  radius: number,
  thick: number,
  colour: string,
  dash: number[] = [],
): void {
  const { context, ratio } = frame;
  context.setLineDash(dash.map((d) => d * ratio));
  context.lineWidth = thick * ratio;
  context.strokeStyle = colour;
  context.beginPath();
  context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
  context.stroke();
  context.setLineDash([]);
}

export function drawTrail(frame: Frame, session: Session, projection: Projection): void {
  const now = session.pose.value?.time ?? 0;
  for (let i = 1; i < session.trail.length; i++) {
    const { p, time } = session.trail[i]!;
    const strength = 0.75 * (1 - (now - time) / 2) * projection.clearness(p);
    if (strength <= 0.02) continue;
    const colour = session.isFresh.value ? `rgba(79, 216, 238, ${strength})` : `rgba(164, 173, 179, ${strength})`;
    line(frame, projection.pixel(session.trail[i - 1]!.p), projection.pixel(p), 1.6, colour);
  }
}

/** Traces the outline of a stadium: convex hull of two discs, whose radii may differ. */
function stadium(
  frame: Frame,
  a: [number, number],
  b: [number, number],
  [first, last]: readonly [number, number],
  thick: number,
  stroke: string,
): void {
  const { context, ratio } = frame;
  const towards = Math.atan2(b[1] - a[1], b[0] - a[0]),
    apart = Math.hypot(b[0] - a[0], b[1] - a[1]);
  // angle of the points of tangency; end-on, one disc contains the other
  const quarter = Math.acos(Math.max(-1, Math.min(1, (first - last) / Math.max(apart, 1e-9))));
  context.beginPath();
  context.arc(...a, first, towards + quarter, towards - quarter);
  context.arc(...b, last, towards - quarter, towards + quarter);
  context.closePath();
  context.lineWidth = thick * ratio;
  context.strokeStyle = stroke;
  context.stroke();
}

/** Draws the device's position, faint, and the line from the tool to it; nothing if the tool covers it. */
function drawDevicePosition(frame: Frame, tool: [number, number], hand: [number, number]): void {
  const { ratio } = frame;
  if (Math.hypot(hand[0] - tool[0], hand[1] - tool[1]) <= 2 * ratio) return;
  line(frame, tool, hand, 3, "rgba(6, 9, 11, 0.6)");
  line(frame, tool, hand, 1.2, "rgba(238, 243, 245, 0.75)", [3, 3]);
  ring(frame, hand, 3.5 * ratio, 3, "rgba(6, 9, 11, 0.6)");
  ring(frame, hand, 3.5 * ratio, 1.3, "rgba(238, 243, 245, 0.75)");
}

/**
 * Draws the capsules, the instrument and the tip at the proxy, and a shadow on the surface in contact.
 * @param tool    pixel of the tip
 * @param radius  of the tip, pixels
 */
function drawToolShape(
  frame: Frame,
  session: Session,
  device: DevicePose,
  projection: Projection,
  tool: [number, number],
  radius: number,
): void {
  const { context, ratio } = frame;
  const pose = session.pose.value!;
  const shown = session.toolAt(device);
  const { radius_mm: tip_mm, capsules } = session.toolOf(device);
  const colour = session.isFresh.value ? TOOL : GREY;
  const isSeen = projection.hasBodies === true && projection.clearness(shown) > 0.5;
  if (isSeen && device.flags & Flag.contact && !(device.flags & Flag.inside)) {
    const foot = add(shown, scale(device.normal, -tip_mm));
    drawContactShadow(context, projection.pixel, foot, device.normal, Math.max(tip_mm, MIN_SHADOW_MM));
  }
  for (const { from_mm, to_mm, radius_mm, end_radius_mm } of capsules) {
    const pointAt = (end: Vec3) => add(shown, session.toPatient(pose, rotate(device.orientation, end)));
    if (projection.capsule) {
      projection.capsule(pointAt(from_mm), pointAt(to_mm), [radius_mm, end_radius_mm], colour);
      continue;
    }
    const at = (end: Vec3) => projection.pixel(pointAt(end));
    const wide = [radius_mm, end_radius_mm].map((mm) => Math.max(1.5 * ratio, mm * projection.pixelsPerMm(shown))) as [
      number,
      number,
    ];
    stadium(frame, at(from_mm), at(to_mm), wide, 3, "rgba(6, 9, 11, 0.6)");
    stadium(frame, at(from_mm), at(to_mm), wide, 1.3, colour);
  }
  // dotted while the tip is on its way to the surface under the cursor
  const dotted = device.number === 0 && session.isTransferring.value ? [1, 3] : [];
  if (isSeen) {
    const per_mm = projection.pixelsPerMm(shown);
    const end = projection.pixel(add(shown, session.toPatient(pose, rotate(device.orientation, [0, 0, 1]))));
    // pointers and hands that never turn have no orientation: their instrument comes from the right hand
    const behind: [number, number] =
      Math.abs(device.orientation[0]) > 1 - 1e-9 ? [0.5 * per_mm, -0.8 * per_mm] : [end[0] - tool[0], end[1] - tool[1]];
    drawInstrument(context, session.toolOf(device), tool, radius, behind, per_mm);
    ring(frame, tool, radius, 1.3, colour, dotted);
  } else {
    ring(frame, tool, radius, 4.5, "rgba(6, 9, 11, 0.75)");
    ring(frame, tool, radius, 2, colour, projection.clearness(shown) < 0.5 ? [4, 3] : dotted);
  }
}

/**
 * Draws the force on the hand as an arrow with its magnitude; nothing below MIN_FORCE_N.
 * @param tool    pixel of the tip
 * @param radius  of the tip, pixels
 */
function drawForce(
  frame: Frame,
  session: Session,
  device: DevicePose,
  projection: Projection,
  tool: [number, number],
  radius: number,
): void {
  const { context, ratio } = frame;
  const pose = session.pose.value!;
  const force_N = length(device.force);
  if (!(force_N > MIN_FORCE_N)) return;
  const unit = session.toPatient(pose, scale(device.force, 1 / force_N));
  const fraction = Math.min(1, force_N / Math.max(device.forceLimit, 0.1));
  const [dx, dy] = projection.direction(unit);
  const long = (16 + 74 * fraction) * ratio;
  const tip: [number, number] = [tool[0] + dx * (long + radius), tool[1] + dy * (long + radius)];
  const from: [number, number] = [tool[0] + dx * radius, tool[1] + dy * radius];
  const shownLength = Math.hypot(tip[0] - from[0], tip[1] - from[1]);
  const arrow = session.isFresh.value ? FORCE : GREY;
  if (shownLength > 5 * ratio) {
    const [ux, uy] = [(tip[0] - from[0]) / shownLength, (tip[1] - from[1]) / shownLength];
    const head = Math.min(10 * ratio, 0.6 * shownLength);
    for (const [thick, stroke] of [
      [5.5, "rgba(6, 9, 11, 0.75)"],
      [2.6, arrow],
    ] as const) {
      line(frame, from, [tip[0] - ux * head * 0.7, tip[1] - uy * head * 0.7], thick, stroke);
    }
    context.beginPath();
    context.moveTo(...tip);
    context.lineTo(tip[0] - ux * head - uy * head * 0.5, tip[1] - uy * head + ux * head * 0.5);
    context.lineTo(tip[0] - ux * head + uy * head * 0.5, tip[1] - uy * head - ux * head * 0.5);
    context.closePath();
    context.lineWidth = 2 * ratio;
    context.strokeStyle = "rgba(6, 9, 11, 0.75)";
    context.stroke();
    context.fillStyle = arrow;
    context.fill();
  } else {
    // force along the viewing direction
    context.beginPath();
    context.arc(tool[0], tool[1], 2.6 * ratio, 0, 2 * Math.PI);
    context.fillStyle = arrow;
    context.fill();
  }
  // magnitude: beyond the arrow's head, or next to the tool if the force is end-on; clamped to the picture
  const isLong = shownLength > 5 * ratio;
  const [wx, wy] = isLong
    ? [tip[0] + dx * 26 * ratio, tip[1] + dy * 14 * ratio]
    : [tool[0] + radius + 28 * ratio, tool[1]];
  const within = (at: number, most: number, margin: number) =>
    Math.min(most - margin * ratio, Math.max(margin * ratio, at));
  text(
    frame,
    quantity(force_N, "N"),
    within(wx, frame.width, 26),
    within(wy, frame.height, 12),
    12,
    arrow,
    "center",
    "middle",
  );
}

/** Draws the tool at its proxy, the device's position, the line between them, and the force. */
export function drawTool(frame: Frame, session: Session, device: DevicePose, projection: Projection): void {
  const { context, ratio } = frame;
  const shown = session.toolAt(device);
  const { radius_mm: tip_mm } = session.toolOf(device);
  const [tool, hand] = [projection.pixel(shown), projection.pixel(device.tip)];
  const radius = Math.max(5 * ratio, tip_mm * projection.pixelsPerMm(shown));
  context.save();
  context.globalAlpha = 0.35 + 0.65 * projection.clearness(shown);
  drawDevicePosition(frame, tool, hand);
  drawToolShape(frame, session, device, projection, tool, radius);
  drawForce(frame, session, device, projection, tool, radius);
  context.restore();
}

/** Draws a bar of the force relative to its limit, at the upper right; for sessions with a pointer as device. */
export function drawForceBar(frame: Frame, session: Session, device: DevicePose): void {
  const { context, width, ratio } = frame;
  const [long, thick] = [96 * ratio, 9 * ratio];
  const [x, y] = [width - long - 12 * ratio, 36 * ratio];
  const fraction = Math.min(1, length(device.force) / Math.max(device.forceLimit, 0.1));
  context.fillStyle = "rgba(6, 9, 11, 0.8)";
  context.fillRect(x - 2 * ratio, y - 2 * ratio, long + 4 * ratio, thick + 4 * ratio);
  context.fillStyle = !session.isFresh.value ? GREY : fraction > 0.95 ? "#ff6b5e" : fraction > 0.7 ? "#ffa94d" : FORCE;
  context.fillRect(x, y, long * fraction, thick);
  text(
    frame,
    words.figureOf(
      quantity(length(device.force), "N"),
      limitQuantity(device.forceLimit, session.state.value?.max_force_N ?? device.forceLimit),
    ),
    width - 12 * ratio,
    y + thick + 5 * ratio,
    11,
    "#eef3f5",
    "right",
    "top",
  );
}

export function drawCross(frame: Frame, at: [number, number]): void {
  const { width, height, ratio } = frame;
  const gap = 9 * ratio;
  const colour = "rgba(79, 216, 238, 0.8)";
  line(frame, [0, at[1]], [at[0] - gap, at[1]], 1, colour);
  line(frame, [at[0] + gap, at[1]], [width, at[1]], 1, colour);
  line(frame, [at[0], 0], [at[0], at[1] - gap], 1, colour);
  line(frame, [at[0], at[1] + gap], [at[0], height], 1, colour);
}

/** Draws the age of stale data in the middle of the picture. */
export function drawAge(frame: Frame, session: Session): void {
  if (session.isFresh.value || !session.pose.value) return;
  const { width, height, ratio } = frame;
  const age =
    session.age_ms.value >= 10000
      ? `${Math.round(session.age_ms.value / 1000)} s`
      : `${(session.age_ms.value / 1000).toFixed(1)} s`;
  text(frame, words.oldData(age), width / 2, height / 2 - 26 * ratio, 15, "#f5c277", "center", "middle");
}

/** Draws the orientation cube, at the lower right above the side mark. */
export function drawCube(frame: Frame, directionOf: (v: Vec3) => Vec3): void {
  const { context, width, height, ratio } = frame;
  const half = 17 * ratio;
  const [cx, cy] = [width - 38 * ratio, height - 62 * ratio];
  const axes: [Vec3, string][] = [
    [[1, 0, 0], "L"],
    [[-1, 0, 0], "R"],
    [[0, 1, 0], "P"],
    [[0, -1, 0], "A"],
    [[0, 0, 1], "S"],
    [[0, 0, -1], "I"],
  ];
  for (const [axis, letter] of axes) {
    const n = directionOf(axis); // right, up, towards the viewer
    if (n[2] <= 0.02) continue;
    const [u, v] = axes
      .map(([a]) => a)
      .filter((a) => a.every((x, i) => x * axis[i]! === 0) && a.some((x) => x > 0)) as [Vec3, Vec3];
    const at = (su: number, sv: number): [number, number] => {
      const p = directionOf(add(axis, add(scale(u, su), scale(v, sv))));
      return [cx + p[0] * half, cy - p[1] * half];
    };
    context.beginPath();
    context.moveTo(...at(-1, -1));
    context.lineTo(...at(1, -1));
    context.lineTo(...at(1, 1));
    context.lineTo(...at(-1, 1));
    context.closePath();
    const light = Math.round(38 + 50 * n[2]);
    context.fillStyle = `rgb(${light}, ${light + 8}, ${light + 14})`;
    context.fill();
    context.lineWidth = ratio;
    context.strokeStyle = "rgba(190, 205, 214, 0.6)";
    context.stroke();
    if (n[2] > 0.35) {
      context.font = `600 ${13 * ratio}px ${FONT}`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillStyle = "#eef3f5";
      context.fillText(letter, cx + n[0] * half, cy - n[1] * half);
    }
  }
}

/** Text about the structure in contact, displayed next to the tool. */
export const touchedText = (session: Session, device: DevicePose): string => session.contactOf(device).words;
