// Reports of the deformation of soft tissue: where material points have moved to (docs/reference/viewer-messages.md).

import { dot, invert, type Affine, type Vec3 } from "../base/geometry.js";
import { PROTOCOL, WireError, WireVersion } from "./wire.js";
import { words } from "../words/words.js";

const MAGIC = 0x59504c50; // "PLPY"
const HEAD_BYTES = 96;
const MAX_DEVICES = 4;
const MAX_AXIS_NODES = 64,
  MAX_NODES = 32768;
/** Upper bound of the magnitude of coordinates in a valid message. */
const MAX_DISTANCE_MM = 1e4;

/** Grid of nodes in the patient: trilinear interpolation inside, zero outside. */
export interface Nodes {
  dims: Vec3;
  nodeFromPatient: Affine;
}

/** Displacements of material points around one device's tool, at nodes in the undeformed configuration. */
export interface DeformationMessage {
  device: number;
  frame: number; // number of the solver frame
  nodes: Nodes | null; // null: no deformation
  moved_mm: Float32Array; // patient frame, three components per node, i fastest
}

/** Whether a binary message reports deformation, not a pose. */
export const isDeformation = (message: ArrayBuffer): boolean =>
  message.byteLength >= 4 && new DataView(message).getUint32(0, true) === MAGIC;

/** @throws WireError for anything but a complete message of this version */
export function decodeDeformation(message: ArrayBuffer): DeformationMessage {
  const refuse = (): never => {
    throw new WireError(words.noDeformation(String(message.byteLength)));
  };
  if (message.byteLength < HEAD_BYTES || !isDeformation(message)) refuse();
  const view = new DataView(message);
  if (view.getUint16(4, true) !== PROTOCOL) throw new WireVersion(words.someOtherVersion(String(PROTOCOL)));
  const three = (at: number, read: (at: number) => number, bytes: number) =>
    [0, 1, 2].map((n) => read(at + bytes * n)) as Vec3;
  const u16 = (at: number) => view.getUint16(at, true),
    f32 = (at: number) => view.getFloat32(at, true);
  const device = u16(6),
    frame = view.getUint32(12, true);
  const [dims, lo, size] = [16, 22, 28].map((at) => three(at, u16, 2)) as [Vec3, Vec3, Vec3];
  const nodes = size[0] * size[1] * size[2];
  if (
    device >= MAX_DEVICES ||
    view.getUint32(8, true) !== message.byteLength ||
    message.byteLength !== HEAD_BYTES + 6 * nodes
  )
    refuse();
  if (nodes === 0) return { device, frame, nodes: null, moved_mm: new Float32Array(0) };

  const first = three(36, f32, 4);
  const axes = [48, 60, 72].map((at) => three(at, f32, 4)) as [Vec3, Vec3, Vec3];
  const spacing = f32(84),
    step = f32(88);
  const isGrid =
    dims.every((count, axis) => count >= 2 && count <= MAX_AXIS_NODES && lo[axis]! + size[axis]! <= count) &&
    dims[0] * dims[1] * dims[2] <= MAX_NODES;
  // NaN fails each of these comparisons
  const areUnit = axes.every((a, n) => Math.abs(dot(a, a) - 1) < 1e-3 && Math.abs(dot(a, axes[(n + 1) % 3]!)) < 1e-3);
  const isPlaced =
    first.every((x) => Math.abs(x) < MAX_DISTANCE_MM) &&
    spacing > 1e-3 &&
    spacing < MAX_DISTANCE_MM &&
    step > 0 &&
    step < 1;
  if (!isGrid || !areUnit || !isPlaced) refuse();

  const moved_mm = new Float32Array(3 * dims[0] * dims[1] * dims[2]);
  for (let k = 0, from = HEAD_BYTES; k < size[2]; k++)
    for (let j = 0; j < size[1]; j++) {
      let to = 3 * (lo[0] + dims[0] * (lo[1] + j + dims[1] * (lo[2] + k)));
      for (let n = 0; n < 3 * size[0]; n++, from += 2) moved_mm[to++] = step * view.getInt16(from, true);
    }
  const patientFromNode: Affine = [
    ...[0, 1, 2].map((r) => [...axes.map((a) => spacing * a[r]!), first[r]!]),
    [0, 0, 0, 1],
  ];
  return { device, frame, nodes: { dims, nodeFromPatient: invert(patientFromNode) }, moved_mm };
}
