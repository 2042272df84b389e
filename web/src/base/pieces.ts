// Cooperative slicing of long computations: the browser handles input between slices.

import type { Vec3 } from "./geometry.js";

/** Number of voxels to copy, sort or upload per slice: some milliseconds of work. */
export const PIECE_VOXELS = 1 << 20;

const waiting: (() => void)[] = [];
let port: MessagePort | null = null; // posts a message that is handled after all pending tasks

/** Yields to all pending tasks, by a message port, because browsers throttle timers of background pages to 1 s. */
export function nextTask(): Promise<void> {
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

/** Calls `work` for consecutive ranges [from, to) of at most `most` up to `count`, and yields after each. */
export async function inPieces(count: number, most: number, work: (from: number, to: number) => void): Promise<void> {
  for (let from = 0; from < count; from += most) {
    work(from, Math.min(from + most, count));
    await nextTask();
  }
}

/** Number of a grid's slices with about PIECE_VOXELS voxels, at least one. */
export const slicesOfPiece = (dims: Vec3): number => Math.max(1, Math.floor(PIECE_VOXELS / (dims[0] * dims[1])));
