// Long work in pieces: between two of them the browser hears its user.

import type { Vec3 } from "./geometry.js";

/** Voxels that are copied, sorted or uploaded at a time: some milliseconds of work. */
export const PIECE_VOXELS = 1 << 20;

const waiting: (() => void)[] = [];
let port: MessagePort | null = null; // what is said to it comes back after whatever waits now

/** Lets everything else that waits have its turn. A timer would wait a second where the page is in the background. */
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

/** Calls `work` for [from, to) until `count` is reached, and breathes between. */
export async function inPieces(count: number, most: number, work: (from: number, to: number) => void): Promise<void> {
  for (let from = 0; from < count; from += most) {
    work(from, Math.min(from + most, count));
    await breathe();
  }
}

/** How many slices of a grid make a piece. */
export const slicesOfPiece = (dims: Vec3): number => Math.max(1, Math.floor(PIECE_VOXELS / (dims[0] * dims[1])));
