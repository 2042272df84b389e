// How tissue has yielded: a coarse grid of displacements over a part of the patient, which the shaders of the volume and of the sections look up.
// Backward: it says how far from a place the tissue that is seen there lay before, so that every pixel asks once and nothing is voxelised anew.

import { column, compose, invert, type Affine, type Vec3 } from "./geometry.js";

/** Nodes of a grid in the patient: linear between them, and no displacement at all outside of them. */
export interface Nodes { dims: Vec3; nodeFromPatient: Affine }

export class Displacement {
  readonly mm: Float32Array<ArrayBuffer>; // of each node, i fastest: patient x, y, z, and a fourth that textures want
  private most: number | null = null; // mm, of all nodes

  constructor(readonly nodes: Nodes) {
    this.mm = new Float32Array(4 * nodes.dims.reduce((a, b) => a * b));
  }

  /** Copies three components a node into a box, i fastest. */
  write(lo: Vec3, size: Vec3, mm: ArrayLike<number>): void {
    const { dims } = this.nodes;
    for (let k = 0, n = 0; k < size[2]; k++) for (let j = 0; j < size[1]; j++) for (let i = 0; i < size[0]; i++) {
      const at = 4 * (lo[0] + i + dims[0] * (lo[1] + j + dims[1] * (lo[2] + k)));
      for (let c = 0; c < 3; c++) this.mm[at + c] = mm[n++]!;
    }
    this.most = null;
  }
  /** Three components a node of a box, i fastest. */
  box(lo: Vec3, size: Vec3): Float32Array<ArrayBuffer> {
    const { dims } = this.nodes;
    const box = new Float32Array(3 * size[0] * size[1] * size[2]);
    for (let k = 0, n = 0; k < size[2]; k++) for (let j = 0; j < size[1]; j++) for (let i = 0; i < size[0]; i++, n += 3) {
      const at = 4 * (lo[0] + i + dims[0] * (lo[1] + j + dims[1] * (lo[2] + k)));
      box.set(this.mm.subarray(at, at + 3), n);
    }
    return box;
  }
  /** The largest there is, mm: between nodes none is larger. */
  get most_mm(): number {
    if (this.most === null) {
      let most = 0;
      for (let n = 0; n < this.mm.length; n += 4) most = Math.max(most, Math.hypot(this.mm[n]!, this.mm[n + 1]!, this.mm[n + 2]!));
      this.most = most;
    }
    return this.most;
  }
}

/** For a shader: `moved`, the place where what is seen at a place is looked up, both in voxels of the volume. Without a displacement it is nothing. */
export const MOVED = `
#if DISPLACED
uniform highp sampler3D displacement; // of nodes, mm
uniform mat4x3 nodeFromVoxel;
uniform mat3 voxelFromMm;
vec3 moved(vec3 voxel) {
  vec3 node = nodeFromVoxel * vec4(voxel, 1.0);
  vec3 last = vec3(textureSize(displacement, 0)) - 1.0;
  vec3 by = voxelFromMm * texture(displacement, (node + 0.5) / (last + 1.0)).xyz;
  return any(lessThan(node, vec3(0.0))) || any(greaterThan(node, last)) ? voxel : voxel + by;
}
#else
#define moved(voxel) (voxel)
#endif`;

/** A displacement where a shader looks it up. */
export class DisplacementTexture {
  private texture: WebGLTexture | null = null;

  constructor(private readonly gl: WebGL2RenderingContext, private readonly unit: number, readonly displacement: Displacement) {
    this.setUp();
  }

  /** All of it; anew after the context was lost. */
  setUp(): void {
    const gl = this.gl;
    const { dims } = this.displacement.nodes;
    this.texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + this.unit);
    gl.bindTexture(gl.TEXTURE_3D, this.texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, gl.LINEAR);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R]) gl.texParameteri(gl.TEXTURE_3D, name, gl.CLAMP_TO_EDGE);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGBA16F, ...dims);
    this.upload([0, 0, 0], dims);
  }
  delete(): void {
    this.gl.deleteTexture(this.texture);
  }

  /** After a box of its nodes has changed. */
  upload(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    const { nodes: { dims }, mm } = this.displacement;
    gl.activeTexture(gl.TEXTURE0 + this.unit);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, dims[0]);
    gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, dims[1]);
    gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, lo[0]);
    gl.pixelStorei(gl.UNPACK_SKIP_ROWS, lo[1]);
    gl.texSubImage3D(gl.TEXTURE_3D, 0, ...lo, ...size, gl.RGBA, gl.FLOAT, mm.subarray(4 * dims[0] * dims[1] * lo[2]));
    for (const name of [gl.UNPACK_ROW_LENGTH, gl.UNPACK_IMAGE_HEIGHT, gl.UNPACK_SKIP_PIXELS, gl.UNPACK_SKIP_ROWS]) gl.pixelStorei(name, 0);
  }

  /** For the program that is in use, whose voxels these are. */
  aim(program: WebGLProgram, voxelFromPatient: Affine): void {
    const gl = this.gl;
    const at = (name: string) => gl.getUniformLocation(program, name);
    const columns = (m: Affine, count: number) => Array.from({ length: count }, (_, c) => column(m, c)).flat();
    gl.uniform1i(at("displacement"), this.unit);
    gl.uniformMatrix4x3fv(at("nodeFromVoxel"), false, columns(compose(this.displacement.nodes.nodeFromPatient, invert(voxelFromPatient)), 4));
    gl.uniformMatrix3fv(at("voxelFromMm"), false, columns(voxelFromPatient, 3));
  }
}

/** How many voxels a displacement of so many mm goes along each axis at most. */
export function reachOf(most_mm: number, voxelFromPatient: Affine): Vec3 {
  // a row's length: how far a mm in the direction that goes farthest leads; textures round a little
  return [0, 1, 2].map((r) => 1.001 * most_mm * Math.hypot(...voxelFromPatient[r]!.slice(0, 3))) as Vec3;
}
