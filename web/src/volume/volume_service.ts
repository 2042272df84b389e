// Rendering of the volume on request: in a worker, so that no picture blocks the page, or on the page if workers have
// no WebGL 2. Pictures are drawn in short bands, so that neither newer requests nor the page's other pictures, which
// share the graphics card, wait for a whole picture.

import type { Nodes } from "../protocol/deformation_message.js";
import { Displacement } from "../drawing/displacement.js";
import { Field } from "./field.js";
import type { Affine, Vec3 } from "../base/geometry.js";
import { nextTask } from "../base/pieces.js";
import type { Piece } from "./texels.js";
import type { View } from "./view.js";
import { Caster } from "./volume_caster.js";

export type Asked =
  | { type: "waits" } // response to "compiles": the page draws nothing until "compiled"
  | { type: "begin"; voxels: Vec3; factor: Vec3; hasScan: boolean; texelFromPatient: Affine }
  | { type: "put"; piece: Piece }
  | { type: "displace"; by: { nodes: Nodes; mm: Float32Array<ArrayBuffer> } | null }
  | { type: "putDisplacement"; lo: Vec3; size: Vec3; mm: Float32Array }
  | { type: "looks"; rgba: Uint8Array<ArrayBuffer>; gloss: Uint8Array<ArrayBuffer> }
  | { type: "haze"; window: [number, number]; strength: number }
  | { type: "draw"; id: number; view: View; isPreemptible: boolean } // isPreemptible: dropped if a newer one is queued
  | { type: "restore" }
  | { type: "lose"; restores: boolean };

/** Counters, for tests. */
export interface Work {
  texels: number;
  appearances: number;
  pictures: number;
}

export type Answered =
  | { type: "ready"; lockName: string } // name of a lock that the worker holds during its lifetime; or ""
  | { type: "unable"; why: string }
  | { type: "compiles" } // a compilation is due, which begins when the page "waits"
  | { type: "compiled" }
  | { type: "begun"; fits: boolean }
  | { type: "put" }
  | {
      type: "picture";
      id: number;
      drawn: { bitmap: ImageBitmap; bytes: Uint8Array; min_mm: number; extent_mm: number } | null;
      cost_ms: number;
      work: Work;
    } // drawn: null if it was dropped or the context was lost
  | { type: "lost" }
  | { type: "restorable" }
  | { type: "restored" };

export interface Port {
  postMessage(message: unknown, transfer: Transferable[]): void;
  onmessage: ((event: MessageEvent) => void) | null;
}

/** Target duration of a band, for which other drawing is blocked. */
const BAND_MS = 16;
const MIN_ROWS = 4;

class Service {
  private readonly queue: Extract<Asked, { type: "draw" }>[] = [];
  private field: Field | null = null;
  private isDrawing = false;
  private readonly pixel_ms = { fine: Infinity, coarse: Infinity }; // time per pixel, averaged over the latest bands
  private readonly waiting: (() => void)[] = []; // callbacks for the message "waits"
  private readonly work: Work = { texels: 0, appearances: 0, pictures: 0 };
  private readonly extension: WEBGL_lose_context | null;

  constructor(
    private readonly port: Port,
    private readonly caster: Caster,
    lockName: string,
  ) {
    const { canvas } = caster;
    this.extension = (canvas.getContext("webgl2") as WebGL2RenderingContext).getExtension("WEBGL_lose_context");
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // asks the browser to restore the context
      this.post({ type: "lost" });
    });
    canvas.addEventListener("webglcontextrestored", () => this.post({ type: "restorable" }));
    port.onmessage = (event) => this.handle(event.data as Asked);
    this.post({ type: "ready", lockName });
  }

  private post(message: Answered, transfer: Transferable[] = []): void {
    this.port.postMessage(message, transfer);
  }

  private handle(asked: Asked): void {
    const { caster } = this;
    switch (asked.type) {
      case "waits":
        this.waiting.shift()?.();
        break;
      case "begin":
        this.post({ type: "begun", fits: this.begin(asked) });
        break;
      case "put":
        this.field!.put(asked.piece);
        caster.upload(asked.piece.lo, asked.piece.size);
        this.work.texels += asked.piece.size.reduce((a, b) => a * b);
        this.post({ type: "put" });
        break;
      case "displace":
        caster.displace(asked.by && new Displacement(asked.by.nodes, asked.by.mm));
        this.post({ type: "put" });
        break;
      case "putDisplacement":
        caster.putDisplacement(asked.lo, asked.size, asked.mm);
        this.post({ type: "put" });
        break;
      case "looks":
        caster.setAppearances(asked.rgba, asked.gloss);
        this.work.appearances += 1;
        break;
      case "haze":
        caster.setHaze(asked.window, asked.strength);
        break;
      case "draw":
        this.queue.push(asked);
        void this.draw();
        break;
      case "restore":
        void caster.restore().then(() => this.post({ type: "restored" }));
        break;
      case "lose":
        if (asked.restores) this.extension?.restoreContext();
        else this.extension?.loseContext();
        break;
    }
  }

  /** Resolves when the page has paused its drawing for a long compilation. */
  private pageWaits(): Promise<void> {
    this.post({ type: "compiles" });
    return new Promise((done) => this.waiting.push(done));
  }

  /**
   * Allocates the field and its textures.
   * @returns whether main and graphics memory suffice
   */
  private begin({ voxels, factor, hasScan, texelFromPatient }: Extract<Asked, { type: "begin" }>): boolean {
    try {
      this.field = new Field(voxels, factor, hasScan);
    } catch (error) {
      if (error instanceof RangeError) return false;
      throw error;
    }
    return this.caster.begin(this.field, texelFromPatient);
  }

  private async draw(): Promise<void> {
    if (this.isDrawing) return;
    this.isDrawing = true;
    for (let asked = this.queue.shift(); asked; asked = this.queue.shift()) await this.picture(asked);
    this.isDrawing = false;
  }

  /** Compiles the shader of a view, for which all other drawing is blocked. */
  private async compile(view: View): Promise<void> {
    await this.pageWaits();
    if (!this.caster.isLost && this.field) {
      this.caster.aim(view);
      this.caster.band(view, 0, 1);
    }
    this.post({ type: "compiled" });
  }

  private async picture({ id, view, isPreemptible }: Extract<Asked, { type: "draw" }>): Promise<void> {
    const { caster } = this;
    const isVoid = () => caster.isLost || !this.field || (isPreemptible && this.queue.length > 0);
    const kind = view.isFine ? "fine" : "coarse";
    let cost_ms = 0;
    let from = 0;
    while (from < view.height && !isVoid()) {
      if (from === 0) {
        if (!caster.isCompiled(view)) await this.compile(view);
        if (isVoid()) break;
        caster.aim(view);
      }
      const rows = Math.max(MIN_ROWS, Math.floor(BAND_MS / (this.pixel_ms[kind] * view.width)));
      const to = Math.min(view.height, from + rows);
      const took_ms = caster.band(view, from, to);
      const pixel_ms = took_ms / ((to - from) * view.width);
      this.pixel_ms[kind] = this.pixel_ms[kind] < Infinity ? 0.5 * (this.pixel_ms[kind] + pixel_ms) : pixel_ms;
      cost_ms += took_ms;
      from = to;
      if (from < view.height) await nextTask();
    }
    const isWhole = from >= view.height && !caster.isLost;
    const drawn = isWhole ? await caster.finish(view) : null;
    if (drawn) this.work.pictures += 1;
    this.post(
      { type: "picture", id, drawn, cost_ms, work: { ...this.work } },
      drawn ? [drawn.bitmap, drawn.bytes.buffer] : [],
    );
  }
}

/**
 * Handles requests at a port by drawing on a canvas.
 * @param lockName  name of a lock that is held during the service's lifetime, or ""
 */
export function serve(port: Port, canvas: OffscreenCanvas | HTMLCanvasElement, lockName = ""): void {
  let caster: Caster;
  try {
    caster = new Caster(canvas);
  } catch (error) {
    port.postMessage({ type: "unable", why: (error as Error).message } satisfies Answered, []);
    return;
  }
  new Service(port, caster, lockName);
}
