// Choice of the slicer: by WebGL 2, or on the main thread where that is unavailable.

import { Slicer, type AnySlicer } from "./slicer.js";

/**
 * Slicer by WebGL 2, else on the main thread.
 * @param onPlain  called if WebGL 2 is unavailable
 */
export async function anySlicer(onPlain: () => void): Promise<AnySlicer> {
  try {
    return new Slicer();
  } catch {
    onPlain();
    const { PlainSlicer } = await import("./plain_slicer.js");
    return new PlainSlicer();
  }
}
