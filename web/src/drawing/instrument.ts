// Instruments drawn as bodies: probe, hook, burr and shaver, with shading by a lamp at the upper left, and the shadow
// of a tool in contact.

import { add, length, scale, tangents, type Vec3 } from "../base/geometry.js";
import type { DeviceTool } from "../protocol/protocol.gen.js";

type At = [number, number]; // canvas pixels

/** Colours of a body across its lit half: edge, middle, highlight, far edge. */
type Metal = readonly [string, string, string, string];
const STEEL: Metal = ["#39434b", "#8f9ca6", "#f4f8fa", "#2a3238"];
const BRASS: Metal = ["#5a4620", "#c9a24c", "#fff3cf", "#463515"];
const HANDLE: Metal = ["#10171c", "#2f424f", "#7f99a8", "#0b1013"];

/** Traces a rod between two discs. */
function traceRod(context: CanvasRenderingContext2D, a: At, b: At, [first, last]: readonly [number, number]): void {
  const towards = Math.atan2(b[1] - a[1], b[0] - a[0]);
  const apart = Math.hypot(b[0] - a[0], b[1] - a[1]);
  // angle of the points of tangency; end-on, one disc contains the other
  const quarter = Math.acos(Math.max(-1, Math.min(1, (first - last) / Math.max(apart, 1e-9))));
  context.beginPath();
  context.arc(...a, first, towards + quarter, towards - quarter);
  context.arc(...b, last, towards - quarter, towards + quarter);
  context.closePath();
}

/** Fills a rod of metal: light across it, whichever way it points. */
export function drawRod(
  context: CanvasRenderingContext2D,
  a: At,
  b: At,
  radii: readonly [number, number],
  metal: Metal = STEEL,
): void {
  const apart = Math.hypot(b[0] - a[0], b[1] - a[1]);
  if (apart < 0.5) return drawBall(context, a, Math.max(...radii), metal);
  // across the rod, from its side at the upper left
  let across: At = [-(b[1] - a[1]) / apart, (b[0] - a[0]) / apart];
  if (across[0] + across[1] > 0) across = [-across[0], -across[1]];
  const wide = Math.max(...radii);
  const gradient = context.createLinearGradient(
    a[0] + across[0] * wide,
    a[1] + across[1] * wide,
    a[0] - across[0] * wide,
    a[1] - across[1] * wide,
  );
  metal.forEach((colour, n) => gradient.addColorStop([0.02, 0.18, 0.36, 0.95][n]!, colour));
  gradient.addColorStop(0.6, metal[1]);
  traceRod(context, a, b, radii);
  context.fillStyle = gradient;
  context.fill();
}

export function drawBall(context: CanvasRenderingContext2D, at: At, radius: number, metal: Metal = STEEL): void {
  const gradient = context.createRadialGradient(
    at[0] - 0.35 * radius,
    at[1] - 0.4 * radius,
    0.05 * radius,
    at[0],
    at[1],
    radius,
  );
  gradient.addColorStop(0, metal[2]);
  gradient.addColorStop(0.35, metal[1]);
  gradient.addColorStop(1, metal[0]);
  context.beginPath();
  context.arc(...at, radius, 0, 2 * Math.PI);
  context.fillStyle = gradient;
  context.fill();
}

/** Flutes of a burr: dark spirals over its ball. */
function drawFlutes(context: CanvasRenderingContext2D, at: At, radius: number, towards: number): void {
  context.save();
  context.beginPath();
  context.arc(...at, radius, 0, 2 * Math.PI);
  context.clip();
  context.translate(...at);
  context.rotate(towards);
  context.lineWidth = Math.max(0.8, 0.1 * radius);
  context.strokeStyle = "rgba(20, 16, 6, 0.55)";
  for (let n = -2; n <= 2; n++) {
    context.beginPath();
    context.ellipse(-0.9 * radius, n * 0.42 * radius, 1.9 * radius, 0.55 * radius, 0.35, -1.2, 1.2);
    context.stroke();
  }
  context.restore();
}

/** Lengths of the drawn part of an instrument behind its tip, mm. */
const NECK_MM = 14;
const SHAFT_MM = 60;

/**
 * Draws the head of a tool and the shaft behind it.
 * @param tool  the tool; its own capsules are drawn by the caller
 * @param at  the tool's origin
 * @param radius  radius of the head
 * @param behind  displacement on the canvas per mm along the shaft, away from the tip
 * @param pixelsPerMm  scale at the tip
 */
export function drawInstrument(
  context: CanvasRenderingContext2D,
  tool: DeviceTool,
  at: At,
  radius: number,
  behind: At,
  pixelsPerMm: number,
): void {
  const cuts = tool.burr !== null;
  const pointAt = (mm: number): At => [at[0] + behind[0] * mm, at[1] + behind[1] * mm];
  const towards = Math.atan2(behind[1], behind[0]);
  // a tool with capsules has its own shaft
  if (tool.capsules.length === 0 || cuts) {
    const begin_mm = Math.max(0, ...tool.capsules.map(({ to_mm, from_mm }) => Math.max(to_mm[2], from_mm[2])));
    const neck = Math.max(1.2, Math.min(0.5 * radius, 1.2 * pixelsPerMm)),
      sleeve = Math.max(2.2, Math.min(1.1 * radius, 2.4 * pixelsPerMm));
    // the part nearer to the viewer last: the shaft comes from above the tip
    if (tool.shaver) {
      drawRod(context, pointAt(begin_mm), pointAt(begin_mm + SHAFT_MM), [sleeve, sleeve]);
    } else {
      drawRod(context, pointAt(begin_mm), pointAt(begin_mm + NECK_MM), [neck, 1.5 * neck]);
      drawRod(
        context,
        pointAt(begin_mm + NECK_MM),
        pointAt(begin_mm + SHAFT_MM),
        [sleeve, 1.25 * sleeve],
        cuts ? STEEL : HANDLE,
      );
    }
  }
  drawBall(context, at, radius, cuts && !tool.shaver ? BRASS : STEEL);
  if (!cuts) return;
  if (!tool.shaver) return drawFlutes(context, at, radius, towards);
  // the window of a shaver
  context.beginPath();
  context.ellipse(...pointAt(0), 0.75 * radius, 0.4 * radius, towards, 0, 2 * Math.PI);
  context.fillStyle = "#11181c";
  context.fill();
}

/**
 * Draws the shadow of a tool on a surface: darkest under the tool, none at three radii.
 * @param foot  point of contact
 * @param outward  unit normal of the surface there
 */
export function drawContactShadow(
  context: CanvasRenderingContext2D,
  pixel: (p: Vec3) => At,
  foot: Vec3,
  outward: Vec3,
  radius_mm: number,
): void {
  if (!(length(outward) > 0.5)) return;
  const [aside, forward] = tangents(outward);
  const middle = pixel(foot);
  const [u, v] = [aside, forward].map((way) => {
    const [x, y] = pixel(add(foot, scale(way, 3 * radius_mm)));
    return [x - middle[0], y - middle[1]];
  }) as [At, At];
  // seen edge-on there is no surface to darken
  if (Math.abs(u[0] * v[1] - u[1] * v[0]) < 1) return;
  context.save();
  context.transform(u[0], u[1], v[0], v[1], ...middle);
  const shade = context.createRadialGradient(0, 0, 0, 0, 0, 1);
  shade.addColorStop(0, "rgba(0, 0, 0, 0.75)");
  shade.addColorStop(0.35, "rgba(0, 0, 0, 0.5)");
  shade.addColorStop(1, "rgba(0, 0, 0, 0)");
  context.fillStyle = shade;
  context.beginPath();
  context.arc(0, 0, 1, 0, 2 * Math.PI);
  context.fill();
  context.restore();
}
