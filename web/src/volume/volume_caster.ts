// Ray casting of the field (field.ts) by a WebGL 2 shader. Colour, opacity and visibility of structures are a lookup
// table of 256 entries.

import type { Displacement } from "../drawing/displacement.js";
import { DisplacementTexture, reachOf } from "../drawing/displacement.js";
import { TEXEL_BYTES, type Field } from "./field.js";
import { add, apply, dot, invert, length, scale, sub, turn, type Affine, type Vec3 } from "../base/geometry.js";
import { halfFloats } from "../base/half_floats.js";
import { inPieces, slicesOfPiece } from "../base/pieces.js";
import { isSoftware, usedProgram } from "../drawing/shader_program.js";
import { SHADING } from "./shading.gen.js";
import { BACKGROUND, type Cut, type View } from "./view.js";
import { FRAGMENT, MIN_SURROUNDINGS_TEXELS, SURROUNDINGS_MM } from "./volume_shader.js";

/** Texture unit of the coverage; the displacement has unit 4. */
const COVERS = 5;
/**
 * Maximum number of texels whose coverage is recomputed on a change of appearances, which takes some milliseconds.
 * Fields without a graphics card are below it, except at full resolution.
 */
const QUICK_TEXELS = 2e6;

/** Variant of the shader: the switches described at FRAGMENT. */
interface Kind {
  scan?: boolean;
  thin?: boolean;
  eye?: boolean;
  cut?: boolean;
  grain?: boolean;
  fine?: boolean;
  rough?: boolean;
  displaced?: boolean;
}

export class Caster {
  readonly isSoftware: boolean;
  private readonly gl: WebGL2RenderingContext;
  private readonly programs = new Map<string, WebGLProgram>();
  private readonly drawn = new Set<string>(); // variants that have been drawn, hence compiled, as JSON
  private program: WebGLProgram | null = null;
  private field: Field | null = null;
  private texelFromPatient: Affine = [];
  private appearances = new Uint8Array(1024);
  private gloss = new Uint8Array(256);
  private skipsValid = false; // the texture of skips is valid for the current appearances and field
  private coversValid = false; // the texture of coverage is valid for the current appearances and field
  private window: Vec3 = [0, 1, 0];
  private target: WebGLFramebuffer | null = null; // framebuffer of colours and depths
  private readonly attached: WebGLRenderbuffer[] = [];
  private size = [0, 0]; // width and height of the target
  private range: [number, number] = [0, 1]; // depths of the current view: minimum and extent, mm
  private readonly pixel = new Uint8Array(4);
  private displacement: DisplacementTexture | null = null;

  /** @throws Error without WebGL 2 */
  constructor(readonly canvas: OffscreenCanvas | HTMLCanvasElement) {
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false }) as WebGL2RenderingContext | null;
    if (!gl) throw new Error("no WebGL 2");
    this.gl = gl;
    this.isSoftware = isSoftware(gl);
    this.setUp();
  }

  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  /** Creates all context objects except the field's textures; also after a context loss. */
  setUp(): void {
    const gl = this.gl;
    this.programs.clear();
    this.drawn.clear();
    gl.disable(gl.DITHER);
    gl.enable(gl.SCISSOR_TEST);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER])
      gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 3);
    this.setAppearances(this.appearances, this.gloss);
    this.target = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.target);
    this.attached.length = 0;
    for (const at of [gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]) {
      const buffer = gl.createRenderbuffer()!;
      gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
      gl.framebufferRenderbuffer(gl.FRAMEBUFFER, at, gl.RENDERBUFFER, buffer);
      this.attached.push(buffer);
    }
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    this.size = [0, 0];
    this.displacement?.setUp();
    this.use({});
  }

  /**
   * Uses a variant of the shader, compiled on first use.
   * @throws Error if the browser rejects the shader
   */
  private use(what: Kind): void {
    const gl = this.gl;
    const define = (name: string, isSo = false) => `#define ${name} ${isSo ? 1 : 0}\n`;
    const head =
      "#version 300 es\n" +
      define("SCAN", what.scan) +
      define("THIN", what.thin) +
      define("EYE", what.eye) +
      define("CUT", what.cut) +
      define("GRAIN", what.grain) +
      define("FINE", what.fine) +
      define("ROUGH", what.rough) +
      define("DISPLACED", what.displaced) +
      define("STRAIN");
    const made = this.programs.get(head);
    if (made) {
      this.program = made;
      return gl.useProgram(made);
    }
    this.program = usedProgram(gl, head + FRAGMENT);
    ["field", "skips", "haze", "appearances"].forEach((name, unit) => gl.uniform1i(this.at(name), unit));
    if (what.rough) gl.uniform1i(this.at("covers"), COVERS);
    gl.uniform3fv(this.at("ground"), BACKGROUND);
    this.programs.set(head, this.program);
  }

  private at(name: string): WebGLUniformLocation | null {
    return this.gl.getUniformLocation(this.program!, name);
  }

  private texture(unit: number, format: GLenum, size: Vec3, filter: GLenum): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.deleteTexture(gl.getParameter(gl.TEXTURE_BINDING_3D) as WebGLTexture | null);
    gl.bindTexture(gl.TEXTURE_3D, gl.createTexture());
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, filter);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(gl.TEXTURE_3D, name, gl.CLAMP_TO_EDGE);
    gl.texStorage3D(gl.TEXTURE_3D, 1, format, ...size);
  }

  /**
   * Allocates textures for a field, whose contents are uploaded by `upload`.
   * @returns whether the graphics memory suffices
   */
  begin(field: Field, texelFromPatient: Affine): boolean {
    const gl = this.gl;
    this.field = field;
    this.texelFromPatient = texelFromPatient;
    while (gl.getError() !== gl.NO_ERROR && !gl.isContextLost());
    this.texture(0, gl.RGBA8UI, field.bordered, gl.NEAREST);
    this.texture(1, gl.R8UI, field.blocks, gl.NEAREST);
    this.texture(2, gl.R16F, field.haze ? field.dims : [1, 1, 1], gl.LINEAR);
    this.texture(COVERS, gl.RG8, this.isQuick ? field.bordered : [1, 1, 1], gl.LINEAR);
    this.skipsValid = this.coversValid = false;
    return gl.getError() === gl.NO_ERROR;
  }

  /** Whether coverage can be recomputed for each change of appearances. */
  private get isQuick(): boolean {
    return this.field!.texels.length <= TEXEL_BYTES * QUICK_TEXELS;
  }

  /** Uploads a box of the field's texels. */
  upload(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    const field = this.field!;
    if (this.coversValid) this.uploadCovers(lo, size);
    const box = (unit: number, stride: Vec3, border: number) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.pixelStorei(gl.UNPACK_ROW_LENGTH, stride[0]);
      gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, stride[1]);
      gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, lo[0] + border);
      gl.pixelStorei(gl.UNPACK_SKIP_ROWS, lo[1] + border);
    };
    // the view begins at the first slice of the box; memory after the last one is not read
    box(0, field.bordered, 1);
    gl.texSubImage3D(
      gl.TEXTURE_3D,
      0,
      lo[0] + 1,
      lo[1] + 1,
      lo[2] + 1,
      ...size,
      gl.RGBA_INTEGER,
      gl.UNSIGNED_BYTE,
      field.texels.subarray(4 * field.bordered[0] * field.bordered[1] * (lo[2] + 1)),
    );
    if (field.haze) {
      const slice = field.dims[0] * field.dims[1];
      box(2, field.dims, 0);
      gl.texSubImage3D(
        gl.TEXTURE_3D,
        0,
        ...lo,
        ...size,
        gl.RED,
        gl.HALF_FLOAT,
        halfFloats(field.haze.subarray(slice * lo[2], slice * (lo[2] + size[2]))),
      );
    }
    for (const name of [gl.UNPACK_ROW_LENGTH, gl.UNPACK_IMAGE_HEIGHT, gl.UNPACK_SKIP_PIXELS, gl.UNPACK_SKIP_ROWS])
      gl.pixelStorei(name, 0);
    this.skipsValid = false;
  }

  /** Uploads the coverage of a box of texels. */
  private uploadCovers(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE0 + COVERS);
    gl.texSubImage3D(
      gl.TEXTURE_3D,
      0,
      lo[0] + 1,
      lo[1] + 1,
      lo[2] + 1,
      ...size,
      gl.RG,
      gl.UNSIGNED_BYTE,
      this.field!.covers(lo, size, this.appearances),
    );
  }

  /** Restores everything after a context loss. */
  async restore(): Promise<void> {
    const field = this.field;
    this.setUp();
    if (!field) return;
    this.begin(field, this.texelFromPatient);
    await inPieces(field.dims[2], slicesOfPiece(field.dims), (from, to) =>
      this.upload([0, 0, from], [field.dims[0], field.dims[1], to - from]),
    );
  }

  /**
   * @param appearances  256 RGBA values: 0 for no structure, then the structures in order
   * @param gloss  256 values of glossOf() in the same order, 0 to 255
   */
  setAppearances(appearances: Uint8Array<ArrayBuffer>, gloss: Uint8Array<ArrayBuffer>): void {
    const gl = this.gl;
    const isSame = (as: (opacity: number) => unknown) =>
      appearances.every((value, n) => n % 4 !== 3 || as(value) === as(this.appearances[n]!));
    this.skipsValid &&= isSame((opacity) => opacity > 0);
    this.coversValid &&= isSame((opacity) => (opacity === 0 ? 0 : opacity === 255 ? 2 : 1));
    [this.appearances, this.gloss] = [appearances, gloss];
    const glossRow = Uint8Array.from({ length: 1024 }, (_, n) => (n % 4 === 0 ? gloss[n / 4]! : 0));
    gl.activeTexture(gl.TEXTURE3);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, appearances);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 2, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, glossRow);
  }

  /** Sets the deformation; null: none. */
  displace(displacement: Displacement | null): void {
    if (displacement && this.displacement?.show(displacement)) return;
    this.displacement?.delete();
    this.displacement = displacement && new DisplacementTexture(this.gl, 4, displacement);
  }
  /** @param mm  displacements of a box of nodes, from displayed positions to positions at rest, patient frame */
  putDisplacement(lo: Vec3, size: Vec3, mm: ArrayLike<number>): void {
    this.displacement?.displacement.write(lo, size, mm);
    this.displacement?.upload(lo, size);
  }

  /**
   * Sets the display of the scan around the structures.
   * @param window  lower and upper end, in stored values of the scan
   * @param strength  0 to 1; 0: none
   */
  setHaze(window: [number, number], strength: number): void {
    this.window = [window[0], 1 / Math.max(window[1] - window[0], 1e-6), strength];
  }

  private kindFor({ eye, cut, isFine }: View): Kind {
    const scan = this.field!.haze !== null && this.window[2] > 0;
    const thin = this.appearances.some((value, n) => n % 4 === 3 && value > 0 && value < 255);
    return {
      scan,
      thin,
      eye: eye !== null,
      cut: cut !== null,
      grain: cut !== null && this.field!.haze !== null,
      fine: isFine,
      rough: !isFine && !cut && this.isQuick,
      displaced: this.displacement !== null,
    };
  }
  /** Whether a view is drawn without compilation. Software WebGL compiles a variant when it is first drawn. */
  isCompiled(view: View): boolean {
    return !this.isSoftware || this.drawn.has(JSON.stringify(this.kindFor(view)));
  }

  /** Sets the view for the following calls of `band`. */
  aim(view: View): void {
    const gl = this.gl;
    const field = this.field!;
    const { eye, cut } = view;
    if (this.size[0] !== view.width || this.size[1] !== view.height) {
      this.size = [view.width, view.height];
      [this.canvas.width, this.canvas.height] = [view.width, view.height];
      for (const buffer of this.attached) {
        gl.bindRenderbuffer(gl.RENDERBUFFER, buffer);
        gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, view.width, view.height);
      }
    }
    gl.viewport(0, 0, view.width, view.height);
    if (!this.skipsValid) {
      gl.activeTexture(gl.TEXTURE1);
      const shown = Array.from({ length: 256 }, (_, position) => this.appearances[4 * position + 3]! > 0);
      gl.texSubImage3D(
        gl.TEXTURE_3D,
        0,
        0,
        0,
        0,
        ...field.blocks,
        gl.RED_INTEGER,
        gl.UNSIGNED_BYTE,
        field.skips(shown),
      );
      this.skipsValid = true;
    }
    const kind = this.kindFor(view);
    if (kind.rough && !this.coversValid) {
      this.uploadCovers([0, 0, 0], field.dims);
      this.coversValid = true;
    }
    this.use(kind);
    const m = this.texelFromPatient;
    if (this.displacement) {
      this.displacement.aim(this.program!, m);
      gl.uniform3fv(this.at("reach"), reachOf(this.displacement.displacement.max_mm, m));
    }
    const into = turn(m, view.into);
    gl.uniform3fv(this.at("dims"), field.dims);
    if (eye) {
      gl.uniform3fv(this.at("corner"), sub(view.corner, eye.at));
      gl.uniform3fv(this.at("across"), view.across);
      gl.uniform3fv(this.at("down"), view.down);
      gl.uniform3fv(this.at("eye"), apply(m, eye.at));
      gl.uniform1f(this.at("nearest_mm"), eye.nearest_mm);
      gl.uniform1f(this.at("light"), 1 / eye.reach_mm ** 2);
      gl.uniform1f(this.at("disc"), eye.isRound ? (view.height / 2) ** 2 : 0);
    } else {
      gl.uniform3fv(this.at("corner"), apply(m, view.corner));
      gl.uniform3fv(this.at("across"), turn(m, view.across));
      gl.uniform3fv(this.at("down"), turn(m, view.down));
      gl.uniform3fv(this.at("into"), into);
      gl.uniform3fv(this.at("inward"), view.into);
      // step along the ray, below one texel along each axis
      gl.uniform1f(this.at("pace"), 0.8 / Math.max(...into.map(Math.abs)));
    }
    // transpose of the linear part of texelFromPatient, in column-major order
    gl.uniformMatrix3fv(
      this.at("patient"),
      false,
      [0, 1, 2].flatMap((r) => [0, 1, 2].map((c) => m[r]![c]!)),
    );
    if (cut) this.setClipping(view, cut);
    this.range = this.depthRange(view);
    gl.uniform2f(this.at("range"), this.range[0], 1 / this.range[1]);
    gl.uniform1f(this.at("height"), view.height);
    gl.uniform3fv(this.at("window"), this.window);
    const [aside, above, towards] = SHADING.keyDirection;
    const key = [
      scale(view.across, aside / length(view.across)),
      scale(view.down, -above / length(view.down)),
      scale(view.into, -towards),
    ].reduce(add);
    // an arthroscope has its own light alone
    gl.uniform4f(this.at("lamp"), ...scale(key, 1 / length(key)), eye?.isRound ? 0 : 1);
    const texelsPerMm = Math.max(...m.map((row) => Math.hypot(row[0]!, row[1]!, row[2]!)));
    gl.uniform1f(this.at("surroundings"), Math.max(MIN_SURROUNDINGS_TEXELS, SURROUNDINGS_MM * texelsPerMm));
  }
  private setClipping({ corner, across, down, into, eye }: View, cut: Cut): void {
    const gl = this.gl;
    const from = sub(cut.at, eye ? eye.at : corner);
    const far = length(from);
    if (eye) gl.uniform4f(this.at("apex"), from[0] / far, from[1] / far, from[2] / far, far);
    else
      gl.uniform4f(
        this.at("apex"),
        dot(from, across) / dot(across, across),
        dot(from, down) / dot(down, down),
        dot(from, into),
        length(across),
      );
    gl.uniform2f(this.at("cone"), cut.radius_mm, 1 / cut.widening);
    const appearances = new Uint8Array(1024);
    appearances.set(this.appearances.subarray(4 * cut.unclipped, 4 * cut.unclipped + 4), 4 * cut.unclipped);
    gl.activeTexture(gl.TEXTURE3);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 1, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, appearances);
  }
  /** Depth range of the volume along a view's rays: minimum and extent, mm. */
  private depthRange({ corner, into, eye }: View): [number, number] {
    const patientFromTexel = invert(this.texelFromPatient);
    const depths = Array.from({ length: 8 }, (_, n) => {
      const end = apply(patientFromTexel, this.field!.dims.map((size, axis) => ((n >> axis) & 1 ? size : -1)) as Vec3);
      return eye ? length(sub(end, eye.at)) : dot(sub(end, corner), into);
    });
    const least = eye ? 0 : Math.min(...depths);
    return [least, Math.max(...depths) - least];
  }

  /**
   * Draws some rows of the picture from the top and waits for completion.
   * @returns duration, ms
   */
  band(view: View, from: number, to: number): number {
    const gl = this.gl;
    this.wait();
    const before = performance.now();
    this.drawn.add(JSON.stringify(this.kindFor(view)));
    gl.scissor(0, view.height - to, view.width, to - from);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.wait();
    return performance.now() - before;
  }
  /**
   * Completed picture, after all bands are drawn.
   * @returns bitmap, bytes of `Found`, and minimum and extent of their depths
   */
  async finish(
    view: View,
  ): Promise<{ bitmap: ImageBitmap; bytes: Uint8Array<ArrayBuffer>; min_mm: number; extent_mm: number }> {
    const gl = this.gl;
    const { width, height } = view;
    const read = (from: GLenum) => {
      const bytes = new Uint8Array(4 * width * height);
      gl.readBuffer(from);
      gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
      return bytes;
    };
    const bytes = read(gl.COLOR_ATTACHMENT1);
    const [min_mm, extent_mm] = this.range;
    // asynchronous, because a blocking read would wait for the page's other pictures, too
    if (this.isSoftware) {
      const pixels = new ImageData(new Uint8ClampedArray(read(gl.COLOR_ATTACHMENT0).buffer), width, height);
      return { bitmap: await createImageBitmap(pixels, { imageOrientation: "flipY" }), bytes, min_mm, extent_mm };
    }
    gl.readBuffer(gl.COLOR_ATTACHMENT0);
    gl.scissor(0, 0, width, height);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, null);
    gl.blitFramebuffer(0, 0, width, height, 0, 0, width, height, gl.COLOR_BUFFER_BIT, gl.NEAREST);
    gl.bindFramebuffer(gl.DRAW_FRAMEBUFFER, this.target);
    const { canvas } = this;
    const bitmap = "transferToImageBitmap" in canvas ? canvas.transferToImageBitmap() : await createImageBitmap(canvas);
    return { bitmap, bytes, min_mm, extent_mm };
  }
  /** Waits for all pending drawing, including the page's other pictures, by reading a pixel. */
  private wait(): void {
    const gl = this.gl;
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, this.pixel);
  }
}
