// Sections by a WebGL 2 shader, in one pass: trilinear interpolation of the scan, nearest neighbour for structures. All
// sections share the 3-D textures.

import type { Displacement } from "../drawing/displacement.js";
import { DisplacementTexture, MOVED } from "../drawing/displacement.js";
import { add, apply, normalOf, scale, turn, type Plane, type Vec3 } from "../base/geometry.js";
import { inPieces, slicesOfPiece } from "../base/pieces.js";
import type { Volumes } from "../protocol/scene.js";
import type { Slab } from "../state/session.js";
import { isSoftware, usedProgram } from "../drawing/shader_program.js";
import { NoMemory } from "../words/errors.js";
import { MIN_STRAIN, MAX_STRAIN, STRAIN_COLOURS } from "../drawing/strain.js";
import { words } from "../words/words.js";

/** GLSL constant, 0 to 1, of a colour, 0 to 255. */
const vec3Literal = (rgb: readonly number[]): string => `vec3(${rgb.map((x) => (x / 255).toFixed(4)).join(", ")})`;

/**
 * Fragment shader in variants, which avoid the cost of unused features.
 * @param isSlab  samples a slab
 * @param isDisplaced  samples the deformation
 * @param isStrained  computes strain
 */
const fragment = (isSlab: boolean, isDisplaced: boolean, isStrained: boolean): string => `#version 300 es
#define SLAB ${Number(isSlab)}
#define DISPLACED ${Number(isDisplaced)}
#define STRAIN ${Number(isStrained)}
precision highp float;
precision highp isampler3D;
precision highp usampler3D;
// as stored, in an integer texture, which keeps all 16 bits but does not interpolate
uniform isampler3D scan;
uniform usampler3D structures;
uniform sampler2D colours;     // RGBA of structures; alpha: opacity
uniform vec3 origin;           // position of the top left corner of the picture, voxels
uniform vec3 acrossStep;       // voxels per pixel
uniform vec3 downStep;
#if SLAB
uniform int samples;           // number of samples through the slab, odd
uniform vec3 throughStep;      // voxels between samples
uniform int kind;              // projection: 0 mean, 1 maximum, 2 minimum
#endif
uniform vec3 dims;
uniform float height;
uniform vec2 window;           // lower and upper end
uniform bool hasScan;
uniform float fill;            // opacity of structures, 0 to 1
uniform bool outlines;
out vec4 colour;
${MOVED}
#if STRAIN
const vec3 STRAINS[${STRAIN_COLOURS.length}] = vec3[](${STRAIN_COLOURS.map(vec3Literal).join(", ")});
#endif

uint structureAt(vec3 voxel) {
  ivec3 nearest = ivec3(floor(moved(voxel) + 0.5));
  if (any(lessThan(nearest, ivec3(0))) || any(greaterThanEqual(nearest, ivec3(dims)))) return 0u;
  return texelFetch(structures, nearest, 0).r;
}

// trilinear interpolation
float scanAt(vec3 voxel) {
  vec3 last = dims - 1.0;
  vec3 within = clamp(voxel, vec3(0.0), last);
  ivec3 low = ivec3(within);
  ivec3 high = min(low + 1, ivec3(last));
  vec3 fraction = within - vec3(low);
  vec4 lows = vec4(texelFetch(scan, low, 0).r, texelFetch(scan, ivec3(low.x, high.y, low.z), 0).r,
                   texelFetch(scan, ivec3(low.xy, high.z), 0).r, texelFetch(scan, ivec3(low.x, high.yz), 0).r);
  vec4 highs = vec4(texelFetch(scan, ivec3(high.x, low.yz), 0).r, texelFetch(scan, ivec3(high.xy, low.z), 0).r,
                    texelFetch(scan, ivec3(high.x, low.y, high.z), 0).r, texelFetch(scan, high, 0).r);
  vec4 along = mix(lows, highs, fraction.x);
  vec2 across = mix(along.xz, along.yw, fraction.y);
  return mix(across.x, across.y, fraction.z);
}

bool isInside(vec3 voxel) {
  return all(greaterThanEqual(voxel, vec3(-0.5))) && all(lessThanEqual(voxel, dims - 0.5));
}

void main() {
  vec3 voxel = origin + gl_FragCoord.x * acrossStep + (height - gl_FragCoord.y) * downStep;
  vec3 shown = vec3(0.035, 0.045, 0.055);
  vec3 position = moved(voxel);
  bool isShown = isInside(position);
  if (hasScan) {
#if SLAB
    // within the volume
    float value = 0.0;
    float count = 0.0;
    for (int n = 0; n < samples; n++) {
      vec3 at = moved(voxel + float(n - samples / 2) * throughStep);
      if (!isInside(at)) continue;
      float here = scanAt(at);
      value = kind == 0 || count == 0.0 ? value + here : kind == 1 ? max(value, here) : min(value, here);
      count += 1.0;
    }
    if (kind == 0) value /= max(count, 1.0);
    isShown = count > 0.0;
#else
    float value = isShown ? scanAt(position) : 0.0;
#endif
    if (isShown) shown = vec3(clamp((value - window.x) / max(window.y - window.x, 1e-6), 0.0, 1.0));
  } else if (isShown) {
    shown = vec3(0.08, 0.09, 0.1);
  }
  uint here = structureAt(voxel);
  vec4 own = texelFetch(colours, ivec2(int(here), 0), 0);
  if (here > 0u && own.a > 0.0) {
    shown = mix(shown, own.rgb, fill * own.a);
    if (outlines) {
      bool border = structureAt(voxel + acrossStep) != here || structureAt(voxel - acrossStep) != here ||
                    structureAt(voxel + downStep) != here || structureAt(voxel - downStep) != here;
      if (border) shown = mix(shown, own.rgb, max(own.a, 0.6));
    }
  }
#if STRAIN
  float by = here > 0u ? strain(voxel) : -1.0;
  if (by >= 0.0) {
    float at = clamp(by / ${MAX_STRAIN}, 0.0, 1.0) * ${STRAIN_COLOURS.length - 1}.0;
    int low = min(int(at), ${STRAIN_COLOURS.length - 2});
    vec3 strained = mix(STRAINS[low], STRAINS[low + 1], at - float(low));
    shown = mix(shown, strained, 0.85 * smoothstep(0.0, ${MIN_STRAIN}, by));
  }
#endif
  colour = vec4(shown, 1.0);
}`;

export interface SliceStyle {
  window: [number, number]; // lower and upper end, in stored values of the scan
  fill: number;
  outlines: boolean;
  strain: boolean; // strain is displayed
  slab: Slab;
}
const KINDS: Slab["kind"][] = ["mean", "maximum", "minimum"];

const FINE = 2,
  COARSE = 1; // samples per voxel through a slab, at full and at reduced resolution

/** Band of a picture: rows [from, to) of a grid whose pixels are `reduction` x `reduction` canvas pixels. */
export interface Band {
  reduction: number;
  from: number;
  to: number;
}

export class Slicer {
  readonly canvas = document.createElement("canvas");
  readonly maxSide: number; // maximum side of a 3-D texture
  /** Whether WebGL is emulated on the CPU, about a hundred times slower than a graphics card. */
  readonly isSoftware: boolean;
  onLost: () => void = () => {};
  /** Callback: the lost context can be restored, by `restore`. */
  onRestorable: () => void = () => {};
  private readonly gl: WebGL2RenderingContext;
  private program: WebGLProgram | null = null; // program in use
  private readonly programs = new Map<string, WebGLProgram>(); // compiled programs by source
  private displacement: DisplacementTexture | null = null;
  // state of the program of each kind of picture: true once its first drawing is complete, else a fence
  private readonly compiled = new Map<string, WebGLSync | true>();
  private readonly textures: WebGLTexture[] = [];
  private volumes: Volumes | null = null; // displayed volumes; null while they are uploaded
  private drawing: WebGLSync | null = null;
  private marked_ms = 0;
  took_ms = 0; // time from the latest completed mark to the end of drawing, ms
  /** Latest drawing time per pixel and sample, of planes and slabs. Software WebGL draws synchronously. */
  private readonly sample_ms: { plane: number; slab: number | null } = { plane: 0, slab: null };
  private readonly extension: WEBGL_lose_context | null;

  /** @throws Error if the browser has no WebGL 2 */
  constructor() {
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error(words.noWebGl);
    this.gl = gl;
    this.maxSide = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
    this.isSoftware = isSoftware(gl);
    this.extension = gl.getExtension("WEBGL_lose_context");
    this.canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault(); // asks the browser to restore the context
      this.onLost();
    });
    this.canvas.addEventListener("webglcontextrestored", () => this.onRestorable());
    this.setUp();
  }

  get isLost(): boolean {
    return this.gl.isContextLost();
  }

  private setUp(): void {
    const gl = this.gl;
    this.programs.clear();
    this.compiled.clear();
    this.use(false, false);
    this.displacement?.setUp();
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    // compiles the shader of planes during the download
    this.allocate([1, 1, 1], true);
    this.isCompiled(false, false);
  }
  /**
   * Whether the shader of a kind of picture is compiled. Software WebGL compiles at the first drawing, which may take a
   * second on a busy machine; this call starts it and does not block.
   */
  isCompiled(isSlab: boolean, isStrained: boolean): boolean {
    const gl = this.gl;
    if (!this.isSoftware || gl.isContextLost()) return true;
    const key = [isSlab, this.displacement !== null, isStrained].join();
    let state = this.compiled.get(key);
    if (state === undefined) {
      this.use(isSlab, isStrained);
      this.displacement?.aim(
        this.program!,
        this.volumes?.voxelFromPatient ?? [
          [1, 0, 0, 0],
          [0, 1, 0, 0],
          [0, 0, 1, 0],
        ],
      );
      gl.viewport(0, 0, 1, 1);
      gl.disable(gl.SCISSOR_TEST);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
      state = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0) ?? true;
      gl.flush();
    }
    if (state !== true && gl.getSyncParameter(state, gl.SYNC_STATUS) === gl.SIGNALED) {
      gl.deleteSync(state);
      state = true;
    }
    this.compiled.set(key, state);
    return state === true;
  }
  private use(isSlab: boolean, isStrained: boolean): void {
    const gl = this.gl;
    const isDisplaced = this.displacement !== null;
    const source = fragment(isSlab, isDisplaced, isDisplaced && isStrained);
    const known = this.programs.get(source);
    this.program = known ?? usedProgram(gl, source);
    if (known) return gl.useProgram(known);
    this.programs.set(source, this.program);
    ["scan", "structures", "colours"].forEach((name, unit) => gl.uniform1i(this.at(name), unit));
  }

  private at(name: string): WebGLUniformLocation | null {
    return this.gl.getUniformLocation(this.program!, name);
  }

  /**
   * Uploads volumes; nothing is drawn until it resolves.
   * @throws Error if the graphics memory is too small
   */
  async load(volumes: Volumes): Promise<void> {
    const gl = this.gl;
    this.volumes = null;
    const [w, h, d] = volumes.dims;
    this.allocate(volumes.dims, volumes.scan !== null);
    this.expectMemory();
    await inPieces(d, slicesOfPiece(volumes.dims), (from, to) => {
      if (volumes.scan) {
        gl.activeTexture(gl.TEXTURE0);
        gl.texSubImage3D(
          gl.TEXTURE_3D,
          0,
          0,
          0,
          from,
          w,
          h,
          to - from,
          gl.RED_INTEGER,
          gl.SHORT,
          volumes.scan.subarray(w * h * from, w * h * to),
        );
      }
      this.upload(volumes, [0, 0, from], [w, h, to - from]);
    });
    this.expectMemory();
    this.volumes = volumes;
  }
  private allocate([w, h, d]: Vec3, hasScan: boolean): void {
    const gl = this.gl;
    this.textures.splice(0).forEach((texture) => gl.deleteTexture(texture));
    const create = (unit: number, target: GLenum) => {
      const texture = gl.createTexture()!;
      this.textures.push(texture);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, texture);
      gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
      gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
      for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
        gl.texParameteri(target, wrap, gl.CLAMP_TO_EDGE);
    };
    create(0, gl.TEXTURE_3D);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.R16I, ...(hasScan ? ([w, h, d] as const) : ([1, 1, 1] as const)));
    create(1, gl.TEXTURE_3D);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.R8UI, w, h, d);
    create(2, gl.TEXTURE_2D);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, 256, 1);
  }

  private expectMemory(): void {
    if (this.gl.getError() !== this.gl.NO_ERROR) throw new NoMemory(words.noGraphicsMemory);
  }

  private upload(volumes: Volumes, lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    const [w, h] = volumes.dims;
    gl.activeTexture(gl.TEXTURE1);
    if (volumes.removed.size > 0) {
      const shown = volumes.shownIn(lo, size);
      gl.texSubImage3D(gl.TEXTURE_3D, 0, ...lo, ...size, gl.RED_INTEGER, gl.UNSIGNED_BYTE, shown);
      return;
    }
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, w);
    gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, h);
    gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, lo[0]);
    gl.pixelStorei(gl.UNPACK_SKIP_ROWS, lo[1]);
    gl.texSubImage3D(
      gl.TEXTURE_3D,
      0,
      ...lo,
      ...size,
      gl.RED_INTEGER,
      gl.UNSIGNED_BYTE,
      volumes.structure.subarray(w * h * lo[2]),
    );
    for (const name of [gl.UNPACK_ROW_LENGTH, gl.UNPACK_IMAGE_HEIGHT, gl.UNPACK_SKIP_PIXELS, gl.UNPACK_SKIP_ROWS])
      gl.pixelStorei(name, 0);
  }

  /** Uploads a box of changed voxels. */
  async update(lo: Vec3, size: Vec3): Promise<void> {
    const volumes = this.volumes;
    if (volumes) {
      await inPieces(size[2], slicesOfPiece([size[0], size[1], 1]), (from, to) =>
        this.upload(volumes, [lo[0], lo[1], lo[2] + from], [size[0], size[1], to - from]),
      );
    }
  }

  /** Sets the deformation; null: none. */
  displace(displacement: Displacement | null): void {
    if (displacement && this.displacement?.show(displacement)) return;
    this.displacement?.delete();
    this.displacement = displacement && new DisplacementTexture(this.gl, 3, displacement);
  }
  /** Uploads a box of changed nodes of the deformation. */
  updateDisplacement(lo: Vec3, size: Vec3): void {
    this.displacement?.upload(lo, size);
  }

  /** Restores everything but colours after a context loss. */
  async restore(volumes: Volumes | null): Promise<void> {
    this.textures.length = 0;
    // a pending fence belongs to the lost context
    this.drawing = null;
    this.setUp();
    try {
      if (volumes) await this.load(volumes);
    } catch (error) {
      // a context lost again causes another event
      if (!this.isLost) throw error;
    }
  }

  /** Marks the end of a frame's drawing; `isDone` becomes true when the frame is complete. */
  mark(): void {
    if (this.isLost) return;
    this.drawing = this.gl.fenceSync(this.gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    this.gl.flush();
    this.marked_ms = performance.now();
  }
  /** Whether the graphics card has completed the frame of the latest mark; further drawing would be queued. */
  get isDone(): boolean {
    const gl = this.gl;
    if (this.drawing && !gl.isContextLost() && gl.getSyncParameter(this.drawing, gl.SYNC_STATUS) !== gl.SIGNALED)
      return false;
    if (this.drawing) this.took_ms = performance.now() - this.marked_ms;
    gl.deleteSync(this.drawing);
    this.drawing = null;
    return true;
  }

  /** Loses or restores the context, like a browser; for tests. */
  lose(restores: boolean): void {
    if (restores) this.extension?.restoreContext();
    else this.extension?.loseContext();
  }

  /** @param rgba  lookup table of 256 colours: 0 for no structure, then the structures in order */
  setColours(rgba: Uint8Array): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE2);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, 256, 1, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  }

  /** Vector through a slab of thickness `mm`, in voxels. */
  private through(plane: Plane, mm: number): Vec3 {
    return turn(this.volumes!.voxelFromPatient, scale(normalOf(plane), mm));
  }
  /** Estimated drawing time of a picture, by the latest time per sample. */
  cost_msOf(plane: Plane, slab: Slab, pixels: number): number {
    const { sample_ms } = this;
    if (!this.volumes || slab.kind === "none") return sample_ms.plane * pixels;
    return (sample_ms.slab ?? sample_ms.plane) * samplesThrough(this.through(plane, slab.mm), FINE) * pixels;
  }

  /** Draws a band of a plane into a context; without volumes, clears it. */
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
    if (width === 0 || height === 0) return;
    const gl = this.gl;
    if (!this.volumes || gl.isContextLost()) {
      // the previous contents show another position
      context.fillStyle = "#090c0e";
      context.fillRect(0, 0, context.canvas.width, context.canvas.height);
      return;
    }
    const began_ms = performance.now();
    if (this.canvas.width < width || this.canvas.height < height) {
      this.canvas.width = Math.max(this.canvas.width, width);
      this.canvas.height = Math.max(this.canvas.height, height);
    }
    const m = this.volumes.voxelFromPatient;
    const corner: Vec3 = add(
      plane.centre,
      add(
        scale(plane.right, (-context.canvas.width / 2) * mmPerPixel),
        scale(plane.down, (-context.canvas.height / 2) * mmPerPixel),
      ),
    );
    const { kind, mm } = style.slab;
    this.use(kind !== "none", style.strain);
    this.displacement?.aim(this.program!, m);
    gl.viewport(0, 0, width, height);
    gl.uniform3fv(this.at("dims"), this.volumes.dims);
    gl.uniform1i(this.at("hasScan"), this.volumes.scan ? 1 : 0);
    gl.uniform3fv(this.at("origin"), apply(m, corner));
    gl.uniform3fv(this.at("acrossStep"), turn(m, scale(plane.right, reduction * mmPerPixel)));
    gl.uniform3fv(this.at("downStep"), turn(m, scale(plane.down, reduction * mmPerPixel)));
    gl.uniform1f(this.at("height"), height);
    gl.uniform2fv(this.at("window"), style.window);
    gl.uniform1f(this.at("fill"), style.fill);
    gl.uniform1i(this.at("outlines"), style.outlines ? 1 : 0);
    const through = this.through(plane, mm);
    const sampleCount = kind === "none" ? 1 : samplesThrough(through, reduction > 1 ? COARSE : FINE);
    if (kind !== "none") {
      gl.uniform1i(this.at("samples"), sampleCount);
      gl.uniform3fv(this.at("throughStep"), scale(through, 1 / (sampleCount - 1)));
      gl.uniform1i(this.at("kind"), KINDS.indexOf(kind));
    }
    const rows = Math.min(to, height) - from;
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(0, height - from - rows, width, rows);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    context.drawImage(
      this.canvas,
      0,
      this.canvas.height - height + from,
      width,
      rows,
      0,
      from * reduction,
      width * reduction,
      rows * reduction,
    );
    this.sample_ms[kind === "none" ? "plane" : "slab"] = (performance.now() - began_ms) / (width * rows * sampleCount);
  }
}

/**
 * Number of samples through a slab; odd, so that one is at its middle.
 * @param through  vector through the slab, in voxels
 * @param density  samples per voxel along the axis with the most voxels; with FINE each extremum is within a quarter
 *   of a voxel of a sample
 */
export const samplesThrough = (through: Vec3, density: number): number =>
  2 * Math.max(1, Math.ceil((density * Math.max(...through.map(Math.abs))) / 2)) + 1;

/** Common interface of the slicers by WebGL 2 and on the main thread. */
export type AnySlicer = Pick<Slicer, keyof Slicer>;
