// The colours that the volume view shows: one RGBA voxel grid of structures and, faintly, the scan around them. Alpha
// is a structure's coverage, smoothed over a voxel each way, so that its surface is round and can be shaded.

import { column, compose, length, normalize, dot, cross, type Affine, type Vec3 } from "./geometry.js";
import { shrunkGrid, type Rgb, type Volumes } from "./scene.js";

export interface Look { colour: Rgb; opacity: number; visible: boolean }

export interface ColourField {
  dims: Vec3;
  origin: Vec3; // patient, of the first voxel's centre
  spacing: Vec3;
  direction: [Vec3, Vec3, Vec3]; // unit, of i, j and k; right-handed
  rgba: Uint8Array;
}

/** What alpha an opacity is stored as: what is solid has its surface where coverage is one half, what is not is a haze. */
export const alphaOf = (opacity: number): number => (opacity <= 0 ? 0 : Math.round(255 * (0.3 + 0.7 * opacity ** 3)));
/** Alpha of the scan around the structures at full strength: below what any structure has on its surface. */
const MOST_SCAN_ALPHA = 36;

/** By how much to coarsen so that there are at most `mostTexels`. */
export function coarsening(dims: Vec3, mostTexels: number): number {
  let factor = 1;
  while (dims.map((n) => Math.ceil(n / factor)).reduce((a, b) => a * b) > mostTexels) factor += 1;
  return factor;
}

/** [1 2 1] / 4 along one axis, in place. */
function smooth(values: Uint16Array, dims: Vec3, axis: 0 | 1 | 2, channels: number): void {
  const stride = channels * [1, dims[0], dims[0] * dims[1]][axis]!;
  const count = dims[axis];
  const voxels = dims[0] * dims[1] * dims[2];
  const inner = [1, dims[0], dims[0] * dims[1]][axis]!;
  for (let start = 0; start < voxels; start += inner * count) {
    for (let lane = 0; lane < inner; lane++) {
      for (let c = 0; c < channels; c++) {
        let at = (start + lane) * channels + c;
        let before = values[at]!;
        for (let n = 0; n < count; n++, at += stride) {
          const here = values[at]!;
          const after = n + 1 < count ? values[at + stride]! : here;
          values[at] = (before + 2 * here + after + 2) >> 2;
          before = here;
        }
      }
    }
  }
}

/**
 * @param looks  of the structures in their order
 * @param scanStrength  0 ... 1
 * @param window  stored values of the scan
 */
export function colourField(volumes: Volumes, looks: Look[], scanStrength: number, window: [number, number],
                            mostTexels: number): ColourField {
  const factor = coarsening(volumes.dims, mostTexels);
  const dims = volumes.dims.map((n) => Math.ceil(n / factor)) as Vec3;
  const [nx, ny, nz] = volumes.dims;

  // a mirrored grid is stored the other way round along i: what draws it wants right-handed axes
  const grid: Affine = factor > 1 ? shrunkGrid(volumes.patientFromVoxel, factor) : volumes.patientFromVoxel;
  const axes = [0, 1, 2].map((c) => column(grid, c));
  const mirrored = dot(cross(axes[0]!, axes[1]!), axes[2]!) < 0;
  const from = mirrored ? compose(grid, [[-1, 0, 0, dims[0] - 1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]) : grid;

  // colours times alpha, so that smoothing does not mix in the colour of nothing
  const shares = new Float32Array(256 * 4);
  looks.forEach((look, place) => {
    const alpha = look.visible ? alphaOf(look.opacity) : 0;
    look.colour.forEach((value, c) => (shares[(place + 1) * 4 + c] = (value * alpha) / 255));
    shares[(place + 1) * 4 + 3] = alpha;
  });
  const scan = scanStrength > 0 ? volumes.scan : null;
  const grey = (value: number) => Math.min(1, Math.max(0, (value - window[0]) / Math.max(window[1] - window[0], 1e-6)));
  const sums = new Uint16Array(dims[0] * dims[1] * dims[2] * 4);
  let out = 0;
  for (let k = 0; k < dims[2]; k++) {
    for (let j = 0; j < dims[1]; j++) {
      for (let x = 0; x < dims[0]; x++, out += 4) {
        const i = mirrored ? dims[0] - 1 - x : x;
        let r = 0, g = 0, b = 0, a = 0, count = 0;
        for (let kk = k * factor; kk < Math.min(nz, (k + 1) * factor); kk++) {
          for (let jj = j * factor; jj < Math.min(ny, (j + 1) * factor); jj++) {
            for (let ii = i * factor; ii < Math.min(nx, (i + 1) * factor); ii++) {
              const index = ii + nx * (jj + ny * kk);
              const at = volumes.structure[index]! * 4;
              count += 1;
              if (shares[at + 3]! > 0) {
                r += shares[at]!;
                g += shares[at + 1]!;
                b += shares[at + 2]!;
                a += shares[at + 3]!;
              } else if (scan) {
                const value = grey(scan[index]!);
                const alpha = value * scanStrength * MOST_SCAN_ALPHA;
                r += value * alpha;
                g += value * alpha;
                b += value * alpha;
                a += alpha;
              }
            }
          }
        }
        if (a > 0) {
          const weight = 64 / count;
          sums[out] = r * weight;
          sums[out + 1] = g * weight;
          sums[out + 2] = b * weight;
          sums[out + 3] = a * weight;
        }
      }
    }
  }
  for (const axis of [0, 1, 2] as const) smooth(sums, dims, axis, 4);

  const rgba = new Uint8Array(sums.length);
  for (let at = 0; at < sums.length; at += 4) {
    const alpha = sums[at + 3]!;
    if (alpha === 0) continue;
    rgba[at] = (255 * sums[at]!) / alpha;
    rgba[at + 1] = (255 * sums[at + 1]!) / alpha;
    rgba[at + 2] = (255 * sums[at + 2]!) / alpha;
    rgba[at + 3] = alpha >> 6;
  }
  const columns = [0, 1, 2].map((c) => column(from, c));
  return {
    dims,
    origin: column(from, 3),
    spacing: columns.map(length) as Vec3,
    direction: columns.map(normalize) as [Vec3, Vec3, Vec3],
    rgba,
  };
}
