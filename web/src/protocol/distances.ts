// Decoding of distances to structures and no-go regions (docs/reference/viewer-messages.md). Lengths in mm, forces in
// N.

import { PROTOCOL, WireError, WireVersion } from "./wire.js";
import { words } from "../words/words.js";

const MAGIC = 0x4e504c50; // "PLPN"
const HEAD_BYTES = 24;
const MAX_DEVICES = 4;
const MAX_NEAR = 8;
const DEVICE_BYTES = 12 + 8 * MAX_NEAR;

/** Distance between a structure and a tool. */
export interface StructureDistance {
  label: number;
  mm: number; // distance between the surfaces of tool and structure; negative: penetration
}
/** Distances of one device's tool. */
export interface DeviceDistances {
  noGo: number; // index of the no-go region with the deepest penetration; -1: none
  depth: number; // penetration depth into that region, margin included
  force: number; // magnitude of the total force of all regions
  structures: StructureDistance[]; // closest first
}

/** Whether a binary message reports distances, not a pose. */
export const isDistanceMessage = (message: ArrayBuffer): boolean =>
  message.byteLength >= 4 && new DataView(message).getUint32(0, true) === MAGIC;

/**
 * Distances of each device's tool.
 * @throws WireError for anything but a complete message of this version
 */
export function decodeDistances(message: ArrayBuffer): DeviceDistances[] {
  const refuse = (): never => {
    throw new WireError(words.noNear(String(message.byteLength)));
  };
  if (message.byteLength < HEAD_BYTES || !isDistanceMessage(message)) refuse();
  const view = new DataView(message);
  if (view.getUint16(4, true) !== PROTOCOL) throw new WireVersion(words.someOtherVersion(String(PROTOCOL)));
  const count = view.getUint16(16, true);
  if (
    count < 1 ||
    count > MAX_DEVICES ||
    view.getUint16(6, true) !== message.byteLength ||
    message.byteLength !== HEAD_BYTES + count * DEVICE_BYTES
  )
    refuse();
  return Array.from({ length: count }, (_, device) => HEAD_BYTES + device * DEVICE_BYTES).map((at) => ({
    noGo: view.getUint16(at, true) - 1,
    depth: view.getFloat32(at + 4, true),
    force: view.getFloat32(at + 8, true),
    structures: Array.from({ length: MAX_NEAR }, (_, n) => at + 12 + 8 * n)
      .map((there) => ({ label: view.getUint16(there, true), mm: view.getFloat32(there + 4, true) }))
      .filter(({ label }) => label !== 0),
  }));
}
