// Slicing of long computations, so that the browser handles input in between.

import type { Vec3 } from "./geometry.js";

/** Number of voxels to copy, sort or upload per slice: some milliseconds of work. */
export const PIECE_VOXELS = 1 << 20;

const waiting: (() => void)[] = [];
let port: MessagePort | null = null; // its messages are handled after all pending tasks

/** Yields to all pending tasks. Browsers throttle timers to one second for pages in the background, hence the port. */
export function breathe(): Promise<void> {
  if (!port) {
    const { port1, port2 } = new MessageChannel();
    port1.onmessage = () => waiting.shift()!();
    port = port2;
  }
  return new Promise((done) => {
    waiting.push(done);
    port!.postMessage(null);
  });
}

/** Calls `work` for consecutive ranges [from, to) up to `count`, and yields in between. */
export async function inPieces(count: number, most: number, work: (from: number, to: number) => void): Promise<void> {
  for (let from = 0; from < count; from += most) {
    work(from, Math.min(from + most, count));
    await breathe();
  }
}

/** Number of grid slices per unit of work. */
export const slicesOfPiece = (dims: Vec3): number => Math.max(1, Math.floor(PIECE_VOXELS / (dims[0] * dims[1])));
