// Sections without WebGL 2, on the main thread: nearest neighbour, no slabs, undeformed tissue. About ten times slower
// than a graphics card; section_view.ts draws coarse pictures first if a full one would block the page for too long.

import { add, apply, scale, turn, type Plane, type Vec3 } from "../base/geometry.js";
import type { Volumes } from "../protocol/scene.js";
import type { AnySlicer, Band, SliceStyle } from "./slicer.js";

const BACKGROUND = [9, 12, 14];
const NO_SCAN = [20, 23, 26];
const MIN_OUTLINE = 0.6;
/** Estimated drawing time per pixel before the first picture. */
const FIRST_PIXEL_MS = 2e-5;

export class PlainSlicer implements AnySlicer {
  readonly canvas = document.createElement("canvas");
  readonly maxSide = 65536;
  readonly isSoftware = true;
  readonly isLost = false;
  readonly isDone = true;
  onLost = (): void => {};
  onRestorable = (): void => {};
  took_ms = 0;
  private began_ms: number | null = null; // start of the first drawing since the latest mark; null: none
  private pixel_ms = FIRST_PIXEL_MS;
  private volumes: Volumes | null = null;
  private colours = new Uint8Array(1024);

  async load(volumes: Volumes): Promise<void> {
    this.volumes = volumes;
  }
  async restore(volumes: Volumes | null): Promise<void> {
    this.volumes = volumes;
  }
  // no effect: voxels are read in place, and deformation is not displayed
  async update(): Promise<void> {}
  displace(): void {}
  updateDisplacement(): void {}
  lose(): void {}
  isCompiled(): boolean {
    return true;
  }

  mark(): void {
    this.took_ms = this.began_ms === null ? 0 : performance.now() - this.began_ms;
    this.began_ms = null;
  }
  setColours(rgba: Uint8Array): void {
    this.colours = rgba.slice();
  }
  cost_msOf(_plane: Plane, _slab: unknown, pixels: number): number {
    return this.pixel_ms * pixels;
  }

  draw(
    context: CanvasRenderingContext2D,
    plane: Plane,
    mmPerPixel: number,
    style: SliceStyle,
    { reduction, from, to }: Band,
  ): void {
    const [width, height] = [context.canvas.width, context.canvas.height].map((size) =>
      Math.ceil(size / reduction),
    ) as [number, number];
    const rows = Math.min(to, height) - from;
    if (width === 0 || rows <= 0) return;
    const began_ms = performance.now();
    this.began_ms ??= began_ms;
    const image = new ImageData(width, rows);
    this.fill(image, plane, mmPerPixel, style, context.canvas, reduction, from);
    if (this.canvas.width < width || this.canvas.height < rows)
      [this.canvas.width, this.canvas.height] = [
        Math.max(this.canvas.width, width),
        Math.max(this.canvas.height, rows),
      ];
    this.canvas.getContext("2d")!.putImageData(image, 0, 0);
    context.drawImage(this.canvas, 0, 0, width, rows, 0, from * reduction, width * reduction, rows * reduction);
    this.pixel_ms = (performance.now() - began_ms) / (width * rows);
  }

  /** Fills an image by the same compositing as the shader in slicer.ts, with nearest-neighbour interpolation. */
  private fill(
    image: ImageData,
    plane: Plane,
    mmPerPixel: number,
    style: SliceStyle,
    whole: { width: number; height: number },
    reduction: number,
    from: number,
  ): void {
    const { volumes, colours } = this;
    const { data, width, height } = image;
    const pixels = new Uint32Array(data.buffer);
    const opaque = ([r, g, b]: number[]): number => (r! | (g! << 8) | (b! << 16) | (255 << 24)) >>> 0;
    pixels.fill(opaque(BACKGROUND));
    if (!volumes) return;
    const {
      voxelFromPatient: m,
      dims: [nx, ny, nz],
      scan,
    } = volumes;
    const corner = add(
      plane.centre,
      add(scale(plane.right, (-whole.width / 2) * mmPerPixel), scale(plane.down, (-whole.height / 2) * mmPerPixel)),
    );
    const across = turn(m, scale(plane.right, reduction * mmPerPixel)),
      down = turn(m, scale(plane.down, reduction * mmPerPixel));
    const origin = apply(m, corner);
    const indexOf = ([x, y, z]: Vec3): number => {
      const [i, j, k] = [Math.round(x), Math.round(y), Math.round(z)];
      return i < 0 || j < 0 || k < 0 || i >= nx || j >= ny || k >= nz ? -1 : i + nx * (j + ny * k);
    };
    const structureAt = (v: Vec3): number => {
      const n = indexOf(v);
      return n < 0 ? 0 : volumes.shownAt(n);
    };
    const [least, most] = style.window;
    const perValue = 255 / Math.max(most - least, 1e-6);
    for (let row = 0, at = 0; row < height; row++) {
      for (let column = 0; column < width; column++, at++) {
        const u = column + 0.5,
          v = from + row + 0.5;
        const voxel: Vec3 = [0, 1, 2].map((axis) => origin[axis]! + u * across[axis]! + v * down[axis]!) as Vec3;
        const n = indexOf(voxel);
        if (n < 0) continue;
        const grey = scan ? Math.min(255, Math.max(0, (scan[n]! - least) * perValue)) : -1;
        let rgb = grey < 0 ? NO_SCAN : [grey, grey, grey];
        const here = volumes.shownAt(n);
        const opacity = colours[4 * here + 3]! / 255;
        if (here > 0 && opacity > 0) {
          const isBorder =
            style.outlines &&
            [across, down].some(
              (step) => structureAt(add(voxel, step)) !== here || structureAt(add(voxel, scale(step, -1))) !== here,
            );
          const fill = style.fill * opacity,
            border = isBorder ? Math.max(opacity, MIN_OUTLINE) : 0;
          const fraction = 1 - (1 - fill) * (1 - border);
          rgb = rgb.map((value, c) => value + fraction * (colours[4 * here + c]! - value));
        }
        pixels[at] = opaque(rgb.map(Math.round));
      }
    }
  }
}
