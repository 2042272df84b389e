// Interface of the page to the renderer of the volume (volume_service.ts), which is a worker, else the page, else
// palpate.

import type { Displacement } from "../drawing/displacement.js";
import { invert, type Vec3 } from "../base/geometry.js";
import { loadModule } from "../words/lazy_module.js";
import { nextTask, slicesOfPiece } from "../base/pieces.js";
import { shrunkGrid, type Memory, type Volumes } from "../protocol/scene.js";
import type { Session } from "../state/session.js";
import type { Served } from "./served_pictures.js";
import { coarsening, pieceOf, texelsFor, texelsOf } from "./texels.js";
import { Found, type View } from "./view.js";
import type { Answered, Asked, Port, Work } from "./volume_service.js";

/** Maximum number of pieces queued at the renderer. */
const AHEAD = 2;
/** Size of a piece with downsampling, relative to one without. */
const COARSE_PIECES = 4;

export interface Drawn {
  bitmap: ImageBitmap;
  found: Found;
  cost_ms: number;
}

export class VolumeRenderer {
  work: Work = { texels: 0, appearances: 0, pictures: 0 };
  onLost: () => void = () => {};
  /** Callback: the lost context can be restored, by `restore`. */
  onRestorable: () => void = () => {};
  /**
   * Callback: the worker has thrown an error or was terminated.
   * @param isReplaced  another worker was started (at most once), into which `restore` loads the volume
   */
  onFailed: (isReplaced: boolean) => void = () => {};
  isInWorker = true;
  /** Whether palpate renders the volume, for lack of WebGL 2. */
  isServed = false;
  /** Returns the volume that palpate renders; null: none. */
  served: () => Served | null = () => null;
  isLoaded = false; // the current volume is loaded completely
  isCompiling = false; // software WebGL is compiling a shader, which blocks all other drawing
  version = ""; // key of volume and appearance
  moved_ms = -Infinity; // time of the latest request with different contents
  private preemptible = 0; // number of pending pictures that give way to newer requests
  private port!: Port;
  private nextId = 1;
  private readonly drawings = new Map<number, { view: View; done: (drawn: Drawn | null) => void }>();
  private readonly answers: Record<"ready" | "begun" | "put" | "restored", ((answer: Answered) => void)[]> = {
    ready: [],
    begun: [],
    put: [],
    restored: [],
  };
  private ready: Promise<Answered>;
  private volumes: Volumes | null = null;
  private loading: Promise<unknown> = Promise.resolve();
  private edits = 0; // number of edits of voxels
  private appearance: Session["appearance"]["value"] | null = null; // appearance that the renderer has
  private appearances = 0; // number of appearances so far
  private haze = "";
  private factor: Vec3 = [1, 1, 1]; // voxels per texel, along each axis
  private memory: Memory = { maxTexels: 0, maxSide: 0 };
  private loads = 0;
  private failures = 0; // number of workers that failed after their start
  private displacement: Displacement | null = null;
  private isEmpty = false; // a new worker does not have the volume yet

  constructor() {
    this.ready = this.answer("ready");
  }

  /**
   * Starts the worker, which handles earlier requests, too. To be called after the first section is drawn, so that the
   * worker's download and start do not delay that.
   */
  begin(): void {
    this.start();
  }

  private start(): void {
    const worker = new Worker(new URL("./volume_worker.ts", import.meta.url), { type: "module" });
    this.port = worker;
    worker.onmessage = (event) => this.handle(event.data as Answered);
    // until the worker is ready, an error means that it cannot run at all
    worker.onerror = () => void this.drawHere();
    void this.ready.then((ready) => {
      if (this.port !== worker) return;
      worker.onerror = () => this.failed(worker);
      // a terminated worker sends no message but releases its lock
      if (ready.type === "ready" && ready.lockName)
        void navigator.locks.request(ready.lockName, () => this.failed(worker));
    });
  }

  /**
   * Handles a failed worker, which is replaced once. There is no fallback to rendering on the page, which might fail in
   * the same way and affect the emergency stop.
   */
  private failed(worker: Worker): void {
    if (this.port !== worker || this.isDead) return;
    worker.terminate();
    this.failures += 1;
    this.isLoaded = this.isCompiling = false;
    this.isEmpty = true;
    [this.appearance, this.haze] = [null, ""];
    if (!this.isDead) {
      this.ready = this.answer("ready");
      this.start();
    }
    // resolves pending requests, which get no response
    this.loads += 1;
    const { drawings, answers } = this;
    for (const { done } of drawings.values()) done(null);
    drawings.clear();
    for (const type of ["begun", "put", "restored"] as const)
      for (const done of answers[type].splice(0)) done({ type: "put" });
    this.onFailed(!this.isDead);
  }
  private get isDead(): boolean {
    return this.failures > 1;
  }

  /** Falls back to rendering on the page. */
  private async drawHere(): Promise<void> {
    if (!this.isInWorker) return;
    this.isInWorker = false;
    (this.port as Worker).terminate();
    const service = await loadModule("volume", () => import("./volume_service.js"));
    if (service) service.serve(this.openPort(), document.createElement("canvas"));
    else await this.drawThere();
  }
  /** Falls back to pictures rendered by palpate. */
  private async drawThere(): Promise<void> {
    if (this.isServed) return;
    this.isServed = true;
    const pictures = await loadModule("volume", () => import("./served_pictures.js"));
    pictures?.servePictures(this.openPort(), () => this.served());
  }
  /**
   * Replaces the port to the worker by a channel.
   * @returns end of the channel for the service
   */
  private openPort(): Port {
    const { port1, port2 } = new MessageChannel();
    this.port = port1;
    port1.onmessage = (event) => this.handle(event.data as Answered);
    return port2;
  }

  private answer(type: keyof typeof this.answers): Promise<Answered> {
    return new Promise((done) => this.answers[type].push(done));
  }
  private post(message: Asked, transfer: Transferable[] = []): void {
    void this.ready.then(() => this.port.postMessage(message, transfer));
  }
  private handle(message: Answered): void {
    switch (message.type) {
      case "unable":
        void (this.isInWorker ? this.drawHere() : this.drawThere());
        break;
      case "picture": {
        const { view, done } = this.drawings.get(message.id)!;
        const { drawn, cost_ms } = message;
        this.drawings.delete(message.id);
        this.work = message.work;
        done(
          drawn && {
            bitmap: drawn.bitmap,
            found: new Found(drawn.bytes, view, drawn.min_mm, drawn.extent_mm),
            cost_ms,
          },
        );
        break;
      }
      case "compiles":
        this.isCompiling = true;
        this.post({ type: "waits" });
        break;
      case "compiled":
        this.isCompiling = false;
        break;
      case "lost":
        this.isLoaded = this.isCompiling = false;
        this.onLost();
        break;
      case "restorable":
        this.onRestorable();
        break;
      default:
        this.answers[message.type].shift()?.(message);
    }
  }

  get isDrawing(): boolean {
    return this.drawings.size > 0;
  }

  /** Loads a volume into the renderer, in pieces. */
  load(volumes: Volumes, memory: Memory): void {
    this.isLoaded = false;
    this.loading = this.bring(volumes, memory).then((isWanted) => {
      this.isLoaded ||= isWanted;
      this.edits += 1;
    });
  }
  /** Resolves when the latest volume is loaded. */
  get loaded(): Promise<unknown> {
    return this.loading;
  }
  /**
   * Loads a volume.
   * @returns false if another volume was requested meanwhile or the worker has failed for good
   */
  private async bring(volumes: Volumes, memory: Memory): Promise<boolean> {
    const load = ++this.loads;
    [this.volumes, this.memory, this.isEmpty] = [volumes, memory, false];
    if (this.isDead) return false;
    for (let { maxTexels } = memory; ; maxTexels = Math.max(1, maxTexels / 2)) {
      this.factor = coarsening(volumes.dims, volumes.edges, { ...memory, maxTexels });
      const texelFromPatient = invert(shrunkGrid(volumes.patientFromVoxel, this.factor));
      this.post({
        type: "begin",
        voxels: volumes.dims,
        factor: this.factor,
        hasScan: volumes.scan !== null,
        texelFromPatient,
      });
      const begun = await this.answer("begun");
      if (load !== this.loads) return false;
      if (begun.type === "begun" && begun.fits) break;
    }
    await this.put([0, 0, 0], this.texels, load);
    return load === this.loads;
  }

  /** Number of texels along each axis. */
  get texels(): Vec3 {
    return texelsFor(this.volumes?.dims ?? [0, 0, 0], this.factor);
  }

  /** Recomputes some texels from the current voxels. */
  private async put(lo: Vec3, size: Vec3, load: number): Promise<void> {
    const { factor } = this;
    // larger pieces with downsampling, which repeats work at the borders of pieces
    const slices = COARSE_PIECES * slicesOfPiece([size[0] * factor[0], size[1] * factor[1], 1]);
    const step = Math.max(1, Math.min(Math.floor(slices / factor[2]), slicesOfPiece(size)));
    const put: Promise<Answered>[] = [];
    for (let z = lo[2]; z < lo[2] + size[2]; z += step) {
      if (load !== this.loads || this.isDead) return;
      const piece = pieceOf(
        this.volumes!,
        factor,
        [lo[0], lo[1], z],
        [size[0], size[1], Math.min(step, lo[2] + size[2] - z)],
      );
      this.post({ type: "put", piece }, [piece.structure.buffer, ...(piece.scan ? [piece.scan.buffer] : [])]);
      put.push(this.answer("put"));
      // keeps AHEAD pieces queued, so that the renderer does not idle
      if (put.length > AHEAD) await put.shift();
      await nextTask();
    }
    await Promise.all(put);
  }

  /** Updates the renderer after a change of a box of voxels. */
  async update(lo: Vec3, size: Vec3): Promise<void> {
    await this.loading;
    const texels = texelsOf(lo, size, this.volumes!.dims, this.factor);
    await this.put(texels.lo, texels.size, this.loads);
    this.edits += 1;
  }

  /** Sets the deformation; null: none. */
  async displace(displacement: Displacement | null): Promise<void> {
    this.displacement = displacement;
    this.edits += 1;
    if (this.isDead) return;
    const by = displacement && { nodes: displacement.nodes, mm: displacement.mm.slice() };
    this.post({ type: "displace", by }, by ? [by.mm.buffer] : []);
    await this.answer("put");
  }
  /** Updates a box of nodes of the deformation. */
  async updateDisplacement(lo: Vec3, size: Vec3): Promise<void> {
    if (!this.displacement || this.isDead) return;
    this.post({ type: "putDisplacement", lo, size, mm: this.displacement.box(lo, size) });
    await this.answer("put");
    this.edits += 1;
  }

  /** Sends the current looks if they have changed. */
  follow(session: Session): void {
    const appearance = session.appearance.value;
    if (this.appearance !== appearance) {
      this.appearance = appearance;
      this.appearances += 1;
      this.setAppearances(appearance.palette, appearance.gloss);
    }
    const haze =
      session.scanInVolume.value > 0 ? JSON.stringify([session.storedWindow(), session.scanInVolume.value]) : "";
    if (haze !== this.haze) {
      this.haze = haze;
      this.setHaze(session.storedWindow(), session.scanInVolume.value);
    }
    this.version = `${this.appearances} ${haze} ${this.edits}`;
  }

  /**
   * @param rgba  256 colours: 0 for no structure, then the structures in order; alpha is the opacity
   * @param gloss  256 values of glossOf() in the same order
   */
  private setAppearances(rgba: Uint8Array<ArrayBuffer>, gloss: Uint8Array<ArrayBuffer>): void {
    this.post({ type: "looks", rgba, gloss });
  }
  /**
   * Sets the display of the scan around the structures.
   * @param window  lower and upper end, in stored values of the scan
   * @param strength  0 to 1; 0: none
   */
  private setHaze(window: [number, number], strength: number): void {
    this.post({ type: "haze", window, strength });
  }

  /**
   * Requests a picture.
   * @param isPreemptible  the picture is dropped if another one is requested before it is complete
   * @returns null if it was dropped or the context was lost
   */
  draw(view: View, isPreemptible: boolean): Promise<Drawn | null> {
    const id = this.nextId++;
    if (this.isDead) return Promise.resolve(null);
    return new Promise((done) => {
      const isDrawn = (drawn: Drawn | null) => {
        if (isPreemptible) this.preemptible -= 1;
        done(drawn);
      };
      if (isPreemptible) this.preemptible += 1;
      this.drawings.set(id, { view, done: isDrawn });
      this.post({ type: "draw", id, view, isPreemptible });
    });
  }

  /** Whether a pending picture would be dropped by another request. */
  get isGivingWay(): boolean {
    return this.preemptible > 0;
  }

  /**
   * Picture that does not give way to other requests.
   * @throws Error if the context was lost
   */
  async drawn(view: View): Promise<Drawn> {
    const drawn = await this.draw(view, false);
    if (!drawn) throw new Error("The graphics were lost.");
    return drawn;
  }

  /** Pixels of a picture: RGBA by rows from the top. */
  async pixels(view: View): Promise<Uint8ClampedArray> {
    const drawn = await this.drawn(view);
    const copy = document.createElement("canvas").getContext("2d", { willReadFrequently: true })!;
    [copy.canvas.width, copy.canvas.height] = [view.width, view.height];
    copy.drawImage(drawn.bitmap, 0, 0);
    drawn.bitmap.close();
    return copy.getImageData(0, 0, view.width, view.height).data;
  }

  /**
   * Restores the renderer after a context loss or a failed worker.
   * @returns whether no worker has failed meanwhile
   */
  async restore(): Promise<boolean> {
    await this.loading;
    const { failures } = this;
    if (!this.isEmpty) {
      this.post({ type: "restore" });
      await this.answer("restored");
      this.isLoaded = failures === this.failures;
      this.edits += 1;
    } else if (this.volumes) {
      this.load(this.volumes, this.memory);
      await this.loading;
      await this.displace(this.displacement);
    }
    return failures === this.failures;
  }

  /** Loses or restores the context, like a browser; for tests. */
  lose(restores: boolean): void {
    this.post({ type: "lose", restores });
  }
}
