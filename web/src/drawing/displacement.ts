// Deformation of soft tissue: a coarse grid of displacements over a region of the patient, sampled by the shaders of
// the volume and of the sections. It is the inverse map, from a deformed position to the position at rest: one lookup
// per sample, and no resampling of voxels.

import type { Nodes } from "../protocol/deformation_message.js";
import { column, compose, invert, type Affine, type Vec3 } from "../base/geometry.js";

export class Displacement {
  private cachedMax_mm: number | null = null; // maximum magnitude over all nodes; null: outdated

  /**
   * @param mm  four components per node, i fastest: displacement in the patient frame, and 1 if strain is known, else 0
   */
  constructor(
    readonly nodes: Nodes,
    readonly mm: Float32Array<ArrayBuffer> = new Float32Array(4 * nodes.dims.reduce((a, b) => a * b)),
  ) {}

  /** Replaces displacements of a box of nodes, three components per node, i fastest. */
  write(lo: Vec3, size: Vec3, mm: ArrayLike<number>): void {
    const { dims } = this.nodes;
    for (let k = 0, n = 0; k < size[2]; k++)
      for (let j = 0; j < size[1]; j++)
        for (let i = 0; i < size[0]; i++) {
          const at = 4 * (lo[0] + i + dims[0] * (lo[1] + j + dims[1] * (lo[2] + k)));
          for (let c = 0; c < 3; c++) this.mm[at + c] = mm[n++]!;
        }
    this.cachedMax_mm = null;
  }
  /** Displacements of a box of nodes, three components per node, i fastest. */
  box(lo: Vec3, size: Vec3): Float32Array<ArrayBuffer> {
    const { dims } = this.nodes;
    const box = new Float32Array(3 * size[0] * size[1] * size[2]);
    for (let k = 0, n = 0; k < size[2]; k++)
      for (let j = 0; j < size[1]; j++)
        for (let i = 0; i < size[0]; i++, n += 3) {
          const at = 4 * (lo[0] + i + dims[0] * (lo[1] + j + dims[1] * (lo[2] + k)));
          box.set(this.mm.subarray(at, at + 3), n);
        }
    return box;
  }
  /** Maximum displacement over all nodes, mm; an upper bound of interpolated ones. */
  get max_mm(): number {
    if (this.cachedMax_mm === null) {
      let most = 0;
      for (let n = 0; n < this.mm.length; n += 4)
        most = Math.max(most, Math.hypot(this.mm[n]!, this.mm[n + 1]!, this.mm[n + 2]!));
      this.cachedMax_mm = most;
    }
    return this.cachedMax_mm;
  }
}

/**
 * GLSL functions: `moved` maps a displayed position to the position at rest, both in voxels of the volume (identity
 * without deformation); `strain`.
 */
export const MOVED = `
#if DISPLACED
uniform highp sampler3D displacement; // displacement at nodes, mm
uniform mat4x3 nodeFromVoxel;
uniform mat3 voxelFromMm;
#if STRAIN
uniform mat3 nodeFromMm;
// Equivalent (von Mises) strain of the deviatoric Euler-Almansi strain at a displayed position; for uniaxial tension of
// incompressible tissue it is the elongation. By finite differences between nodes. Negative: unknown.
float strain(vec3 voxel) {
  vec3 size = vec3(textureSize(displacement, 0));
  vec3 node = (nodeFromVoxel * vec4(voxel, 1.0) + 0.5) / size;
  vec4 here = texture(displacement, node);
  vec3 step = 1.0 / size;
  mat3 byNode;
  for (int axis = 0; axis < 3; axis++) {
    vec3 offset = vec3(axis == 0, axis == 1, axis == 2) * step;
    byNode[axis] = 0.5 * (texture(displacement, node + offset).xyz - texture(displacement, node - offset).xyz);
  }
  mat3 slope = byNode * nodeFromMm;
  mat3 by = -0.5 * (slope + transpose(slope) + transpose(slope) * slope);
  float mean = (by[0][0] + by[1][1] + by[2][2]) / 3.0;
  by -= mat3(mean);
  bool isBeside = any(lessThan(node, vec3(0.0))) || any(greaterThan(node, vec3(1.0)));
  return isBeside || here.w < 0.999 ? -1.0 : sqrt((dot(by[0], by[0]) + dot(by[1], by[1]) + dot(by[2], by[2])) / 1.5);
}
#endif
vec3 moved(vec3 voxel) {
  vec3 node = nodeFromVoxel * vec4(voxel, 1.0);
  vec3 last = vec3(textureSize(displacement, 0)) - 1.0;
  vec3 by = voxelFromMm * texture(displacement, (node + 0.5) / (last + 1.0)).xyz;
  return any(lessThan(node, vec3(0.0))) || any(greaterThan(node, last)) ? voxel : voxel + by;
}
#else
#define moved(voxel) (voxel)
#endif`;

/** Displacement field as 3-D textures. */
export class DisplacementTexture {
  private texture: WebGLTexture | null = null;

  constructor(
    private readonly gl: WebGL2RenderingContext,
    private readonly unit: number,
    private its: Displacement,
  ) {
    this.setUp();
  }
  get displacement(): Displacement {
    return this.its;
  }

  /**
   * Uploads another field into the same textures.
   * @returns false, without effect, if its number of nodes differs
   */
  show(displacement: Displacement): boolean {
    const { dims } = displacement.nodes;
    if (dims.some((count, axis) => count !== this.its.nodes.dims[axis])) return false;
    this.its = displacement;
    this.upload([0, 0, 0], dims);
    return true;
  }

  /** Creates the textures and uploads the whole field; also after a context loss. */
  setUp(): void {
    const gl = this.gl;
    const { dims } = this.displacement.nodes;
    this.texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0 + this.unit);
    gl.bindTexture(gl.TEXTURE_3D, this.texture);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_3D, name, gl.LINEAR);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T, gl.TEXTURE_WRAP_R])
      gl.texParameteri(gl.TEXTURE_3D, name, gl.CLAMP_TO_EDGE);
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGBA16F, ...dims);
    this.upload([0, 0, 0], dims);
  }
  delete(): void {
    this.gl.deleteTexture(this.texture);
  }

  /** Uploads a box of nodes that has changed. */
  upload(lo: Vec3, size: Vec3): void {
    const gl = this.gl;
    const {
      nodes: { dims },
      mm,
    } = this.displacement;
    gl.activeTexture(gl.TEXTURE0 + this.unit);
    gl.pixelStorei(gl.UNPACK_ROW_LENGTH, dims[0]);
    gl.pixelStorei(gl.UNPACK_IMAGE_HEIGHT, dims[1]);
    gl.pixelStorei(gl.UNPACK_SKIP_PIXELS, lo[0]);
    gl.pixelStorei(gl.UNPACK_SKIP_ROWS, lo[1]);
    gl.texSubImage3D(gl.TEXTURE_3D, 0, ...lo, ...size, gl.RGBA, gl.FLOAT, mm.subarray(4 * dims[0] * dims[1] * lo[2]));
    for (const name of [gl.UNPACK_ROW_LENGTH, gl.UNPACK_IMAGE_HEIGHT, gl.UNPACK_SKIP_PIXELS, gl.UNPACK_SKIP_ROWS])
      gl.pixelStorei(name, 0);
  }

  /** Sets the uniforms of `program`, which must be in use. */
  aim(program: WebGLProgram, voxelFromPatient: Affine): void {
    const gl = this.gl;
    const at = (name: string) => gl.getUniformLocation(program, name);
    const columns = (m: Affine, count: number) => Array.from({ length: count }, (_, c) => column(m, c)).flat();
    gl.uniform1i(at("displacement"), this.unit);
    const { nodeFromPatient } = this.displacement.nodes;
    gl.uniformMatrix4x3fv(at("nodeFromVoxel"), false, columns(compose(nodeFromPatient, invert(voxelFromPatient)), 4));
    gl.uniformMatrix3fv(at("nodeFromMm"), false, columns(nodeFromPatient, 3));
    gl.uniformMatrix3fv(at("voxelFromMm"), false, columns(voxelFromPatient, 3));
  }
}

/** Bounds of the displacement along each voxel axis, in voxels, for a displacement of at most `max_mm`. */
export function reachOf(max_mm: number, voxelFromPatient: Affine): Vec3 {
  // row norms of voxelFromPatient, with a margin for rounding in textures
  return [0, 1, 2].map((r) => 1.001 * max_mm * Math.hypot(...voxelFromPatient[r]!.slice(0, 3))) as Vec3;
}
