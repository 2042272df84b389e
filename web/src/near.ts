// What is near each tool and what keeps it away, as palpate tells it (docs/reference/viewer-messages.md). Lengths in mm, forces in N.

import { PROTOCOL, WireError, WireVersion } from "./wire.js";
import { words } from "./words.js";

const MAGIC = 0x4e504c50; // "PLPN"
const HEAD_BYTES = 24;
const MOST_DEVICES = 4;
const MOST_NEAR = 8;
const DEVICE_BYTES = 12 + 8 * MOST_NEAR;

/** A structure near a tool. */
export interface NearStructure {
  label: number;
  mm: number; // from the tool's outline to its surface; below 0 inside
}
/** Of one device. */
export interface Near {
  noGo: number; // place of the region that the tool is deepest in; -1: none pushes
  depth: number; // in what that one is to keep away
  force: number; // of all regions together
  structures: NearStructure[]; // nearest first
}

/** Whether a binary message is of what is near, not a pose. */
export const isNear = (message: ArrayBuffer): boolean => message.byteLength >= 4 && new DataView(message).getUint32(0, true) === MAGIC;

/** Of each device. @throws WireError for anything that is not a whole message of this version */
export function decodeNear(message: ArrayBuffer): Near[] {
  const refuse = (): never => { throw new WireError(words.noNear(String(message.byteLength))); };
  if (message.byteLength < HEAD_BYTES || !isNear(message)) refuse();
  const view = new DataView(message);
  if (view.getUint16(4, true) !== PROTOCOL) throw new WireVersion(words.someOtherVersion(String(PROTOCOL)));
  const count = view.getUint16(16, true);
  if (count < 1 || count > MOST_DEVICES || view.getUint16(6, true) !== message.byteLength || message.byteLength !== HEAD_BYTES + count * DEVICE_BYTES) refuse();
  return Array.from({ length: count }, (_, device) => HEAD_BYTES + device * DEVICE_BYTES).map((at) => ({
    noGo: view.getUint16(at, true) - 1,
    depth: view.getFloat32(at + 4, true),
    force: view.getFloat32(at + 8, true),
    structures: Array.from({ length: MOST_NEAR }, (_, n) => at + 12 + 8 * n)
      .map((there) => ({ label: view.getUint16(there, true), mm: view.getFloat32(there + 4, true) }))
      .filter(({ label }) => label !== 0),
  }));
}
