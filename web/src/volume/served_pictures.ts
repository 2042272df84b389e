// Volume rendering by palpate, for browsers without WebGL 2 (docs/reference/viewer-http.md, "Pictures"). Messages are
// those of the worker. One picture is requested at a time, always the newest.

import type { Vec3 } from "../base/geometry.js";
import { transport } from "../protocol/transport.js";
import type { View } from "./view.js";
import type { Answered, Asked, Port, Work } from "./volume_service.js";

/** Volume that palpate renders: hash and number of structures. */
export interface Served {
  hash: string;
  structures: number;
  token: string | null;
}

type Draw = Extract<Asked, { type: "draw" }>;

const HEAD_BYTES = 24;
const AGAIN_MS = 500; // interval of retries after a failure

/**
 * Parameters of a picture request: docs/reference/viewer-http.md.
 * @param appearances  RGBA of each structure
 */
export function pictureQuery(view: View, appearances: Uint8Array): string {
  const { width, height, corner, across, down, eye, cut, into } = view;
  const numbers = (values: readonly number[]): string =>
    values.map((value) => String(Number(value.toPrecision(9)))).join(",");
  const query = [`view=${numbers([width, height, ...corner, ...across, ...down, ...(eye?.at ?? [])])}`];
  if (appearances.length > 0)
    query.push(`looks=${Array.from(appearances, (byte) => byte.toString(16).padStart(2, "0")).join("")}`);
  // the protocol supports clipping by planes only
  if (cut && cut.widening === Infinity) query.push(`cut=${numbers([...cut.at, ...(into.map((x) => -x) as Vec3)])}`);
  return query.join("&");
}

/**
 * Colours and depths of a response.
 * @throws RangeError if its size is wrong
 */
export function readPicture(bytes: ArrayBuffer): {
  width: number;
  height: number;
  rgba: Uint8ClampedArray<ArrayBuffer>;
  found: Uint8Array<ArrayBuffer>;
  min_mm: number;
  extent_mm: number;
} {
  const head = new DataView(bytes);
  const isOne = bytes.byteLength >= HEAD_BYTES && head.getUint32(0, false) === 0x504c5056;
  const [width, height] = isOne ? [head.getUint16(8, true), head.getUint16(10, true)] : [0, 0];
  const pixels = width * height;
  if (!isOne || bytes.byteLength !== HEAD_BYTES + 6 * pixels) throw new RangeError();
  const rgb = new Uint8Array(bytes, HEAD_BYTES, 3 * pixels);
  const depths = new DataView(bytes, HEAD_BYTES + 3 * pixels, 2 * pixels);
  const structures = new Uint8Array(bytes, HEAD_BYTES + 5 * pixels, pixels);
  const rgba = new Uint8ClampedArray(4 * pixels);
  const found = new Uint8Array(4 * pixels);
  for (let row = 0, n = 0; row < height; row++) {
    for (let column = 0; column < width; column++, n++) {
      rgba.set([rgb[3 * n]!, rgb[3 * n + 1]!, rgb[3 * n + 2]!, 255], 4 * n);
      const depth = depths.getUint16(2 * n, true);
      // rows from the bottom, as `Found` has them
      found.set([depth >> 8, depth & 255, structures[n]!], 4 * (column + width * (height - 1 - row)));
    }
  }
  return { width, height, rgba, found, min_mm: head.getFloat32(12, true), extent_mm: head.getFloat32(16, true) };
}

class ServedPictures {
  private readonly queue: Draw[] = [];
  private appearances = new Uint8Array(1024);
  private isDrawing = false;
  private readonly work: Work = { texels: 0, appearances: 0, pictures: 0 };

  constructor(
    private readonly port: Port,
    private readonly served: () => Served | null,
  ) {
    port.onmessage = (event) => this.handle(event.data as Asked);
    this.post({ type: "ready", lockName: "" });
  }
  private post(message: Answered, transfer: Transferable[] = []): void {
    this.port.postMessage(message, transfer);
  }
  private handle(asked: Asked): void {
    switch (asked.type) {
      case "begin":
        return this.post({ type: "begun", fits: true });
      case "put":
      case "displace":
      case "putDisplacement":
        return this.post({ type: "put" });
      case "restore":
        return this.post({ type: "restored" });
      case "looks":
        this.appearances = asked.rgba;
        this.work.appearances += 1;
        return;
      case "draw":
        this.queue.push(asked);
        void this.draw();
    }
  }
  private async draw(): Promise<void> {
    if (this.isDrawing) return;
    this.isDrawing = true;
    for (let asked = this.queue.shift(); asked; asked = this.queue.shift()) {
      // drops a request that gives way if a newer one is queued
      const drawn =
        asked.isPreemptible && this.queue.length > 0 ? null : await this.picture(asked.view).catch(() => null);
      if (drawn) this.work.pictures += 1;
      else if (this.queue.length === 0) await new Promise((later) => setTimeout(later, AGAIN_MS));
      this.post(
        {
          type: "picture",
          id: asked.id,
          drawn: drawn?.drawn ?? null,
          cost_ms: drawn?.cost_ms ?? 0,
          work: { ...this.work },
        },
        drawn ? [drawn.drawn.bitmap, drawn.drawn.bytes.buffer] : [],
      );
    }
    this.isDrawing = false;
  }
  private async picture(view: View): Promise<{
    drawn: { bitmap: ImageBitmap; bytes: Uint8Array<ArrayBuffer>; min_mm: number; extent_mm: number };
    cost_ms: number;
  } | null> {
    const served = this.served();
    if (!served) return null;
    const began_ms = performance.now();
    const query = pictureQuery(view, this.appearances.subarray(4, 4 * (Math.min(served.structures, 255) + 1)));
    const response = await transport().get(`/api/picture/${served.hash}?${query}`, served.token);
    if (!response.ok) return null;
    const { width, height, rgba, found, min_mm, extent_mm } = readPicture(await response.arrayBuffer());
    const bitmap = await createImageBitmap(new ImageData(rgba, width, height));
    return { drawn: { bitmap, bytes: found, min_mm, extent_mm }, cost_ms: performance.now() - began_ms };
  }
}

/** Handles requests at a port by pictures that palpate renders. */
export function servePictures(port: Port, served: () => Served | null): void {
  new ServedPictures(port, served);
}
