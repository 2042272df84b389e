// Points, rotations and planes in the patient frame: LPS, mm. +x is the patient's left, +y posterior, +z superior.

export type Vec3 = [number, number, number];
/** Unit quaternion: w, x, y, z. */
export type Quaternion = [number, number, number, number];
/** Affine map of points: 4 x 4 matrix by rows, the last one 0 0 0 1. */
export type Affine = number[][];

export const add = (a: Vec3, b: Vec3): Vec3 => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
export const sub = (a: Vec3, b: Vec3): Vec3 => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
export const scale = (a: Vec3, s: number): Vec3 => [a[0] * s, a[1] * s, a[2] * s];
export const dot = (a: Vec3, b: Vec3): number => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
export const cross = (a: Vec3, b: Vec3): Vec3 => [
  a[1] * b[2] - a[2] * b[1],
  a[2] * b[0] - a[0] * b[2],
  a[0] * b[1] - a[1] * b[0],
];
export const length = (a: Vec3): number => Math.hypot(a[0], a[1], a[2]);
export const normalize = (a: Vec3): Vec3 => scale(a, 1 / (length(a) || 1));
/** Component of `a` orthogonal to the unit vector `n`. */
export const reject = (a: Vec3, n: Vec3): Vec3 => sub(a, scale(n, dot(a, n)));
/** Two unit vectors that form an orthonormal basis with a unit vector. */
export function tangents(n: Vec3): [Vec3, Vec3] {
  const first = normalize(reject(Math.abs(n[0]) < 0.8 ? [1, 0, 0] : [0, 1, 0], n));
  return [first, cross(n, first)];
}

export const apply = (m: Affine, p: Vec3): Vec3 =>
  [0, 1, 2].map((r) => m[r]![0]! * p[0] + m[r]![1]! * p[1] + m[r]![2]! * p[2] + m[r]![3]!) as Vec3;
/** Image of a direction: the linear part of the map only. */
export const turn = (m: Affine, v: Vec3): Vec3 =>
  [0, 1, 2].map((r) => m[r]![0]! * v[0] + m[r]![1]! * v[1] + m[r]![2]! * v[2]) as Vec3;

export const column = (m: Affine, c: number): Vec3 => [m[0]![c]!, m[1]![c]!, m[2]![c]!];

export function invert(m: Affine): Affine {
  const [a, b, c] = [column(m, 0), column(m, 1), column(m, 2)];
  const determinant = dot(a, cross(b, c));
  if (!Number.isFinite(1 / determinant)) throw new Error("a matrix that cannot be inverted");
  const rows = [cross(b, c), cross(c, a), cross(a, b)].map((row) => scale(row, 1 / determinant));
  const t = column(m, 3);
  return [...rows.map((row) => [...row, -dot(row, t)]), [0, 0, 0, 1]];
}
/** Composition: applies `b`, then `a`. */
export function compose(a: Affine, b: Affine): Affine {
  return [0, 1, 2, 3].map((r) =>
    [0, 1, 2, 3].map((c) => [0, 1, 2, 3].reduce((sum, k) => sum + a[r]![k]! * b[k]![c]!, 0)),
  );
}

export function rotate(q: Quaternion, v: Vec3): Vec3 {
  const u: Vec3 = [q[1], q[2], q[3]];
  const t = scale(cross(u, v), 2);
  return add(add(v, scale(t, q[0])), cross(u, t));
}
export const conjugate = (q: Quaternion): Quaternion => [q[0], -q[1], -q[2], -q[3]];
/** Composition: rotates by `b`, then by `a`. */
export function multiply(a: Quaternion, b: Quaternion): Quaternion {
  return [
    a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
    a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
    a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
    a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
  ];
}
export function normalizeQuaternion(q: Quaternion): Quaternion {
  const norm = Math.hypot(...q);
  return norm > 0 ? (q.map((x) => x / norm) as Quaternion) : [1, 0, 0, 0];
}
export function aboutAxis(axis: Vec3, angle_rad: number): Quaternion {
  const n = scale(normalize(axis), Math.sin(angle_rad / 2));
  return [Math.cos(angle_rad / 2), ...n];
}
/** Pinch factor: ratio of the distances between two fingers after and before one of them has moved. */
export function spread(other: [number, number], before: [number, number], at: [number, number]): number {
  const apart = (p: [number, number]) => Math.hypot(p[0] - other[0], p[1] - other[1]);
  return apart(at) / Math.max(1, apart(before));
}

/** Rotation angle, 0 to 180 degrees. */
export const angleOf_deg = (q: Quaternion): number =>
  (2 * Math.atan2(Math.hypot(q[1], q[2], q[3]), Math.abs(q[0])) * 180) / Math.PI;

/** Plane of a picture in the patient frame. */
export interface Plane {
  centre: Vec3; // centre of the picture
  right: Vec3; // unit, to the right of the picture
  down: Vec3; // unit, to the bottom of the picture, orthogonal to `right`
}
/** Unit normal into the picture, away from the viewer. */
export const normalOf = (plane: Plane): Vec3 => cross(plane.right, plane.down);

export type Anatomical = "axial" | "sagittal" | "coronal";
/** Kind of a section's plane: an anatomical plane, or the oblique plane that follows the tip. */
export type PlaneKind = "oblique" | Anatomical;
export const ANATOMICAL: Anatomical[] = ["axial", "sagittal", "coronal"];

const LEFT: Vec3 = [1, 0, 0];
const POSTERIOR: Vec3 = [0, 1, 0];
const SUPERIOR: Vec3 = [0, 0, 1];

/**
 * Anatomical plane in the radiological convention: the patient's left on the right of axial and coronal pictures,
 * anterior on the left of sagittal ones.
 */
export function anatomicalPlane(kind: Anatomical, centre: Vec3): Plane {
  return {
    centre,
    right: kind === "sagittal" ? POSTERIOR : LEFT,
    down: kind === "axial" ? POSTERIOR : scale(SUPERIOR, -1),
  };
}

/** Anatomical planes whose display convention an oblique plane follows; hysteresis state between frames. */
export interface Hanging {
  axial: boolean;
  sagittal: boolean;
}

/**
 * Displays a plane in the radiological convention: superior up, or anterior up if the plane is nearly axial; the
 * patient's left on the right, or anterior on the left if it is nearly sagittal.
 * @param before  `hanging` of the previous frame, for hysteresis
 */
export function hang(normal: Vec3, centre: Vec3, before?: Hanging): { plane: Plane; hanging: Hanging } {
  const n = normalize(normal);
  const near = (axis: Vec3, was?: boolean) => Math.abs(dot(n, axis)) > (was === undefined ? 0.8 : was ? 0.75 : 0.85);
  const hanging = { axial: near(SUPERIOR, before?.axial), sagittal: near(LEFT, before?.sagittal) };
  const down = normalize(reject(hanging.axial ? POSTERIOR : scale(SUPERIOR, -1), n));
  let right = normalize(cross(down, n));
  if (dot(right, hanging.sagittal ? POSTERIOR : LEFT) < 0) right = scale(right, -1);
  return { plane: { centre, right, down }, hanging };
}

/**
 * Unit normal, as close to `wanted` as possible, of a plane that contains a direction (tool axis or force). For a
 * direction nearly parallel to `wanted`, as close to `fallback` as possible.
 */
export function normalContaining(direction: Vec3, wanted: Vec3, fallback: Vec3): Vec3 {
  const d = normalize(direction);
  const n = reject(wanted, d);
  return length(n) > 0.1 ? normalize(n) : normalize(reject(fallback, d));
}

/**
 * Orientation letters of `direction`, the dominant axis first: "L", or "LA" if it is more than 20 degrees off that
 * axis; a third letter if its component is at least sin 20 degrees too. palpate's own sections use the same rule.
 */
export function directionLetters(direction: Vec3): string {
  const d = normalize(direction);
  const oblique = (20 * Math.PI) / 180;
  const axes = [0, 1, 2].sort((a, b) => Math.abs(d[b]!) - Math.abs(d[a]!));
  const letter = (axis: number) => ["RL", "AP", "IS"][axis]![d[axis]! < 0 ? 0 : 1]!;
  let letters = letter(axes[0]!);
  // tolerance for rounding at exactly 20 degrees
  if (Math.abs(d[axes[0]!]!) < Math.cos(oblique) - 1e-9) {
    letters += letter(axes[1]!);
    if (Math.abs(d[axes[2]!]!) > Math.sin(oblique) + 1e-9) letters += letter(axes[2]!);
  }
  return letters;
}
export interface Letters {
  left: string;
  right: string;
  top: string;
  bottom: string;
}
/** Letters at the four edges of a picture, from its right and down directions in the patient. */
export const orientationLetters = (right: Vec3, down: Vec3): Letters => ({
  left: directionLetters(scale(right, -1)),
  right: directionLetters(right),
  top: directionLetters(scale(down, -1)),
  bottom: directionLetters(down),
});

/** Largest length of 1, 2 or 5 times a power of ten that does not exceed `max_mm`. */
export function niceLength(max_mm: number): number {
  const power = 10 ** Math.floor(Math.log10(max_mm));
  return power * (max_mm >= 5 * power ? 5 : max_mm >= 2 * power ? 2 : 1);
}

/** Text of a position, patient frame (LPS), with explicit signs in the displayed convention. */
export function positionText(p: Vec3, convention: "LPS" | "RAS", decimals: number): string {
  const named = convention === "LPS" ? p : [-p[0], -p[1], p[2]];
  // a plus sign keeps columns aligned
  const texts = named.map((x) => (x < 0 ? "−" : "+") + Math.abs(x).toFixed(decimals));
  return `${convention} ${texts.join("  ")} mm`;
}

export function angleAt_deg(corner: Vec3, a: Vec3, b: Vec3): number {
  const u = normalize(sub(a, corner));
  const v = normalize(sub(b, corner));
  return (Math.atan2(length(cross(u, v)), dot(u, v)) * 180) / Math.PI;
}

/** Fraction of a picture's width or height that an object takes which just fits. */
const FITTED = 0.94;
/**
 * Factor by which a picture of `width` x `height` has to show less, so that points just fit.
 * @param points  projections, from the picture's centre
 */
export function fitFactor(points: [number, number][], width: number, height: number): number {
  return Math.max(...points.map(([x, y]) => Math.max((2 * Math.abs(x)) / width, (2 * Math.abs(y)) / height))) / FITTED;
}
