// Draws planes of scan and structures: linear scan, nearest structure, in one pass of a WebGL2 shader. The 3-D textures
// are uploaded once and shared by every plane on the page.

import { add, apply, scale, turn, type Plane, type Vec3 } from "./geometry.js";
import type { Volumes } from "./scene.js";

const VERTEX = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  gl_Position = vec4(corner, 0.0, 1.0);
}`;

const FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler3D;
precision highp usampler3D;
uniform sampler3D scan;
uniform usampler3D structures;
uniform sampler2D colours;     // of structures; alpha: opacity
uniform vec3 origin;           // voxel of the pixel's corner (0, 0) on top left
uniform vec3 acrossStep;       // voxels a pixel
uniform vec3 downStep;
uniform vec3 dims;
uniform float height;
uniform vec2 window;           // least and largest value
uniform bool hasScan;
uniform float fill;            // 0 ... 1
uniform bool outlines;
out vec4 colour;

uint structureAt(vec3 voxel) {
  ivec3 nearest = ivec3(floor(voxel + 0.5));
  if (any(lessThan(nearest, ivec3(0))) || any(greaterThanEqual(nearest, ivec3(dims)))) return 0u;
  return texelFetch(structures, nearest, 0).r;
}

void main() {
  vec3 voxel = origin + gl_FragCoord.x * acrossStep + (height - gl_FragCoord.y) * downStep;
  vec3 coordinate = (voxel + 0.5) / dims;
  bool inside = all(greaterThanEqual(coordinate, vec3(0.0))) && all(lessThanEqual(coordinate, vec3(1.0)));
  vec3 shown = vec3(0.035, 0.045, 0.055);
  if (inside && hasScan) {
    float value = texture(scan, coordinate).r;
    shown = vec3(clamp((value - window.x) / max(window.y - window.x, 1e-6), 0.0, 1.0));
  } else if (inside) {
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
  colour = vec4(shown, 1.0);
}`;

export interface SliceStyle {
  window: [number, number]; // stored values
  fill: number;
  outlines: boolean;
}

/** 16-bit floats hold whole numbers exactly up to 2048, and to 11 bits beyond: enough for 256 greys. */
function halfFloats(): Uint16Array {
  const table = new Uint16Array(65536);
  for (let bits = 0; bits < 65536; bits++) {
    const value = bits < 32768 ? bits : bits - 65536;
    const size = Math.abs(value);
    if (size === 0) continue;
    let exponent = Math.floor(Math.log2(size));
    let mantissa = Math.round((size / 2 ** exponent - 1) * 1024);
    if (mantissa === 1024) {
      mantissa = 0;
      exponent += 1;
    }
    table[bits] = (value < 0 ? 0x8000 : 0) | ((exponent + 15) << 10) | mantissa;
  }
  return table;
}

export class Slicer {
  readonly canvas = document.createElement("canvas");
  readonly mostSide: number; // of a 3-D texture
  private readonly gl: WebGL2RenderingContext;
  private readonly program: WebGLProgram;
  private readonly textures: WebGLTexture[] = [];
  private volumes: Volumes | null = null;

  /** @throws Error where the browser has no WebGL2 */
  constructor() {
    const gl = this.canvas.getContext("webgl2", { alpha: false, antialias: false, preserveDrawingBuffer: true });
    if (!gl) throw new Error("This browser has no WebGL 2. It is needed to show the scan.");
    this.gl = gl;
    this.mostSide = gl.getParameter(gl.MAX_3D_TEXTURE_SIZE) as number;
    this.program = gl.createProgram()!;
    for (const [type, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
      const shader = gl.createShader(type)!;
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader) ?? "shader");
      gl.attachShader(this.program, shader);
    }
    gl.linkProgram(this.program);
    gl.useProgram(this.program);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
    gl.disable(gl.DITHER);
    ["scan", "structures", "colours"].forEach((name, unit) => gl.uniform1i(this.at(name), unit));
  }

  private at(name: string): WebGLUniformLocation | null {
    return this.gl.getUniformLocation(this.program, name);
  }

  load(volumes: Volumes): void {
    const gl = this.gl;
    this.textures.splice(0).forEach((texture) => gl.deleteTexture(texture));
    this.volumes = volumes;
    const [w, h, d] = volumes.dims;
    const create = (unit: number, target: GLenum, filter: GLenum) => {
      const texture = gl.createTexture()!;
      this.textures.push(texture);
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(target, texture);
      gl.texParameteri(target, gl.TEXTURE_MIN_FILTER, filter);
      gl.texParameteri(target, gl.TEXTURE_MAG_FILTER, filter);
      for (const wrap of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(target, wrap, gl.CLAMP_TO_EDGE);
    };
    create(0, gl.TEXTURE_3D, gl.LINEAR);
    if (volumes.scan) {
      const table = halfFloats();
      const halves = new Uint16Array(volumes.scan.length);
      for (let i = 0; i < halves.length; i++) halves[i] = table[volumes.scan[i]! & 0xffff]!;
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.R16F, w, h, d, 0, gl.RED, gl.HALF_FLOAT, halves);
    } else {
      gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8, 1, 1, 1, 0, gl.RED, gl.UNSIGNED_BYTE, new Uint8Array(1));
    }
    create(1, gl.TEXTURE_3D, gl.NEAREST);
    gl.texImage3D(gl.TEXTURE_3D, 0, gl.R8UI, w, h, d, 0, gl.RED_INTEGER, gl.UNSIGNED_BYTE, volumes.structure);
    create(2, gl.TEXTURE_2D, gl.NEAREST);
    if (gl.getError() !== gl.NO_ERROR) throw new Error("The graphics memory does not hold the volume.");
    gl.uniform3f(this.at("dims"), w, h, d);
    gl.uniform1i(this.at("hasScan"), volumes.scan ? 1 : 0);
  }

  /** @param rgba  256 colours: 0 nothing, then the structures in their order */
  setColours(rgba: Uint8Array): void {
    const gl = this.gl;
    gl.activeTexture(gl.TEXTURE2);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 256, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, rgba);
  }

  /** Draws into `context`, which is width x height pixels. */
  draw(context: CanvasRenderingContext2D, plane: Plane, mmPerPixel: number, style: SliceStyle): void {
    const { width, height } = context.canvas;
    if (!this.volumes || width === 0 || height === 0) return;
    const gl = this.gl;
    if (this.canvas.width < width || this.canvas.height < height) {
      this.canvas.width = Math.max(this.canvas.width, width);
      this.canvas.height = Math.max(this.canvas.height, height);
    }
    const m = this.volumes.voxelFromPatient;
    const corner: Vec3 = add(plane.centre, add(scale(plane.right, (-width / 2) * mmPerPixel), scale(plane.down, (-height / 2) * mmPerPixel)));
    gl.viewport(0, 0, width, height);
    gl.uniform3fv(this.at("origin"), apply(m, corner));
    gl.uniform3fv(this.at("acrossStep"), turn(m, scale(plane.right, mmPerPixel)));
    gl.uniform3fv(this.at("downStep"), turn(m, scale(plane.down, mmPerPixel)));
    gl.uniform1f(this.at("height"), height);
    gl.uniform2fv(this.at("window"), style.window);
    gl.uniform1f(this.at("fill"), style.fill);
    gl.uniform1i(this.at("outlines"), style.outlines ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    context.drawImage(this.canvas, 0, this.canvas.height - height, width, height, 0, 0, width, height);
  }
}
