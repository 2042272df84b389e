// The volume in one place of the page: coarse pictures while something moves, a sharp one when it has come to rest.

import type { Picture } from "./picture.js";
import { BACKGROUND, type Found, type View } from "./view.js";
import type { VolumeRenderer } from "./volume_renderer.js";

/** A picture that took longer is drawn coarser while something moves. */
const SLOW_MS = 40;
const STILL_AFTER_MS = 250;
const COARSEST = 4;
/** What a picture at full size is taken to cost without a graphics card, before there was one. */
const FIRST_MS = 160;

/** What a picture is taken of, so that what is drawn over it stands where it stood then. */
export interface Shot<Camera> {
  camera: Camera;
  /** @param reduction  pixels of the screen in one of the picture */
  view(reduction: number): View;
}

export class LivePicture<Camera> {
  /** What is seen now. */
  seen: { bitmap: ImageBitmap; found: Found; camera: Camera } | null = null;
  private key = ""; // of the picture that was asked for last
  private reduction: number;
  private isWanted = false;
  private sharp = false; // or asked for
  private asked: "" | "coarse" | "sharp" = ""; // what is being drawn
  private asks = 0;
  private take: (() => Shot<Camera>) | null = null; // of how things are when it is called
  private cost_ms: number; // of a picture at full size

  /** @param isSquare  as high or as wide as its place, in the middle of it */
  constructor(private readonly picture: Picture, private readonly renderer: VolumeRenderer, private readonly isSoftware: boolean,
              private readonly isSquare: boolean, private readonly onSeen: () => void) {
    this.reduction = isSoftware ? 2 : 1;
    // the first one comes soon
    this.cost_ms = isSoftware ? FIRST_MS : 0;
  }

  /**
   * To be called for every frame: asks for a picture where there is to be another one.
   * @param key  of what it shows; @param isHeld  it may move at any moment
   */
  update(now: number, key: string, isHeld: boolean, take: () => Shot<Camera>): void {
    const { renderer } = this;
    this.take = take;
    if (key !== this.key) {
      this.key = key;
      renderer.moved_ms = now;
      this.isWanted = true;
      this.sharp = false;
    } else if (!this.sharp && now - renderer.moved_ms > STILL_AFTER_MS && !isHeld && !renderer.isGivingWay) this.isWanted = this.sharp = true; // one after the other
    this.ask();
  }
  private ask(): void {
    if (!this.isWanted || !this.take || !this.renderer.isLoaded || !(this.asked === "" || (this.asked === "sharp" && !this.sharp))) return;
    this.isWanted = false;
    void this.render(this.take());
  }

  /** What is seen is as sharp as it gets. */
  get isSharp(): boolean {
    return this.seen !== null && this.sharp && !this.isWanted && this.asked === "";
  }
  /** So coarse that it costs little while something moves. */
  private async render(shot: Shot<Camera>): Promise<void> {
    const { ratio } = this.picture.frame();
    const least = this.isSoftware ? Math.max(ratio, 1.5) : 1;
    const coarse = Math.max(1, this.cost_ms > SLOW_MS ? Math.min(COARSEST, Math.sqrt(this.cost_ms / SLOW_MS)) : 1) * this.reduction;
    const total = Math.max(this.sharp ? 1 : coarse, least);
    const isSharp = (this.sharp = total === least);
    this.asked = isSharp ? "sharp" : "coarse";
    const ask = ++this.asks;
    const drawn = await this.renderer.draw({ ...shot.view(total / ratio), isFine: isSharp }, isSharp);
    if (drawn) this.cost_ms = drawn.cost_ms * total * total;
    if (ask === this.asks) {
      this.asked = "";
      if (!drawn) this.sharp = false;
      // what has moved meanwhile waits for no frame of the page
      this.ask();
    }
    if (!drawn) return;
    this.seen?.bitmap.close();
    this.seen = { bitmap: drawn.bitmap, found: drawn.found, camera: shot.camera };
    this.show();
    // it may have been hidden while this was drawn, and has no size then
    if (this.picture.isShown) this.onSeen();
  }

  /** Puts what is seen into the picture, or nothing where there is nothing. */
  show(): void {
    const { base } = this.picture;
    const { width, height } = base.canvas;
    base.fillStyle = `rgb(${BACKGROUND.map((x) => Math.round(255 * x)).join(" ")})`;
    base.fillRect(0, 0, width, height);
    if (!this.seen) return;
    base.imageSmoothingQuality = "high";
    const [w, h] = this.isSquare ? [Math.min(width, height), Math.min(width, height)] : [width, height];
    base.drawImage(this.seen.bitmap, (width - w) / 2, (height - h) / 2, w, h);
  }
  /** The graphics were lost: there is no picture until they come back. */
  lost(): void {
    this.seen?.bitmap.close();
    this.seen = null;
    this.key = "";
    this.show();
  }
}
