// Progressive picture of the volume: coarse during motion, sharp at rest.

import type { Picture } from "../drawing/picture.js";
import { BACKGROUND, type Found, type View } from "./view.js";
import type { VolumeRenderer } from "./volume_renderer.js";

/** Rendering time to which pictures are limited during motion, by a lower resolution. */
const SLOW_MS = 40;
const STILL_AFTER_MS = 250;
const COARSEST = 4;
/** Estimated rendering time of a full-size picture without a graphics card, before the first one. */
const FIRST_MS = 160;

/** Camera of a picture, stored with it so that overlays match the displayed picture. */
export interface Shot<Camera> {
  camera: Camera;
  /** @param reduction  CSS pixels per picture pixel */
  view(reduction: number): View;
}

export class LivePicture<Camera> {
  /** Displayed picture; null: none yet. */
  latest: { bitmap: ImageBitmap; found: Found; camera: Camera; width: number; height: number } | null = null;
  private key = ""; // key of the current contents
  private reduction: number;
  private isWanted = false;
  private sharp = false; // the displayed or the requested picture is sharp
  private pendingQuality: "" | "coarse" | "sharp" = ""; // quality of the picture that is being rendered
  private asks = 0;
  private shoot: (() => Shot<Camera>) | null = null; // returns the camera at the time of the call
  private cost_ms: number; // rendering time of a full-size picture, estimated by the latest one

  /** @param isSquare  the picture is a centred square whose side is the element's shorter side */
  constructor(
    private readonly picture: Picture,
    private readonly renderer: VolumeRenderer,
    private readonly isSoftware: boolean,
    private readonly isSquare: boolean,
    private readonly onSeen: () => void,
  ) {
    this.reduction = isSoftware ? 2 : 1;
    // the first picture is coarse without a graphics card, to be displayed soon
    this.cost_ms = isSoftware ? FIRST_MS : 0;
  }

  /**
   * Requests a picture if needed; to be called for every frame.
   * @param key  key of all that the picture depends on
   * @param isDragging  the user is dragging, so that motion may resume at any moment: no sharp picture
   */
  update(now: number, key: string, isDragging: boolean, shoot: () => Shot<Camera>): void {
    const { renderer } = this;
    this.shoot = shoot;
    if (key !== this.key) {
      this.key = key;
      renderer.moved_ms = now;
      this.isWanted = true;
      this.sharp = false;
    } else if (!this.sharp && now - renderer.moved_ms > STILL_AFTER_MS && !isDragging && !renderer.isGivingWay)
      this.isWanted = this.sharp = true; // the sharp picture, which follows the coarse one
    this.requestPicture();
  }
  private requestPicture(): void {
    if (
      !this.isWanted ||
      !this.shoot ||
      !this.renderer.isLoaded ||
      !(this.pendingQuality === "" || (this.pendingQuality === "sharp" && !this.sharp))
    )
      return;
    this.isWanted = false;
    void this.render(this.shoot());
  }

  /** Whether the displayed picture is sharp. */
  get isSharp(): boolean {
    return this.latest !== null && this.sharp && !this.isWanted && this.pendingQuality === "";
  }
  /** Renders and shows a picture: during motion, at a resolution for which it should take at most SLOW_MS. */
  private async render(shot: Shot<Camera>): Promise<void> {
    const { ratio, width, height } = this.picture.frame();
    const least = this.isSoftware ? Math.max(ratio, 1.5) : 1;
    const coarse =
      Math.max(1, this.cost_ms > SLOW_MS ? Math.min(COARSEST, Math.sqrt(this.cost_ms / SLOW_MS)) : 1) * this.reduction;
    const total = Math.max(this.sharp ? 1 : coarse, least);
    const isSharp = (this.sharp = total === least);
    this.pendingQuality = isSharp ? "sharp" : "coarse";
    const ask = ++this.asks;
    const drawn = await this.renderer.draw({ ...shot.view(total / ratio), isFine: isSharp }, isSharp);
    if (drawn) this.cost_ms = drawn.cost_ms * total * total;
    if (ask === this.asks) {
      this.pendingQuality = "";
      if (!drawn) this.sharp = false;
      // requests the picture of motion meanwhile without waiting for the next frame
      this.requestPicture();
    }
    if (!drawn) return;
    this.latest?.bitmap.close();
    this.latest = { bitmap: drawn.bitmap, found: drawn.found, camera: shot.camera, width, height };
    this.show();
    // a picture that was hidden meanwhile has no size
    if (this.picture.isShown) this.onSeen();
  }

  /** Copies the latest bitmap into the picture's canvas, or clears it. */
  show(): void {
    const { base } = this.picture;
    const { width, height } = base.canvas;
    base.fillStyle = `rgb(${BACKGROUND.map((x) => Math.round(255 * x)).join(" ")})`;
    base.fillRect(0, 0, width, height);
    if (!this.latest) return;
    const side = Math.min(this.latest.width, this.latest.height);
    if (this.isSquare) this.picture.drawScaled(this.latest.bitmap, side, side);
    else this.picture.drawScaled(this.latest.bitmap, this.latest.width, this.latest.height);
  }
  /** Scale of the displayed picture, which may have been rendered for another size. */
  get scale(): number {
    return this.latest ? this.picture.scaleOf(this.latest.width, this.latest.height) : 1;
  }
  /** Discards the picture after a context loss. */
  lost(): void {
    this.latest?.bitmap.close();
    this.latest = null;
    this.key = "";
    this.show();
  }
}
