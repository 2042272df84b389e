// Deformation of soft tissue by all devices. palpate reports where material points have moved to; pictures need the
// inverse, from displayed positions to positions at rest, which is computed here.

import { apply, column, invert, type Affine, type Vec3 } from "../base/geometry.js";
import type { Nodes, DeformationMessage } from "../protocol/deformation_message.js";

/** Number of nodes beyond a grid over which the displacement at its border fades to zero. */
const FADE_NODES = 3;
/** Number of nodes over which displacement is extrapolated into empty space next to displaced tissue. */
const EMPTY_LAYERS = 4;
/** Maximum number of nodes of the inverse grid, which is recomputed up to fifteen times a second. */
const MAX_INVERSE_NODES = 40_000;
/** Tolerance and maximum number of steps of the fixed-point inversion, which converges fast unless tissue is folded. */
const TOLERANCE_MM = 0.002,
  MAX_ITERATIONS = 12;

/** Displacement field of one tool, defined everywhere in the patient. */
class Field {
  readonly patientFromNode: Affine;
  private readonly mm: Float32Array;
  private readonly low = [0, 0, 0];
  private readonly weights = [0, 0, 0]; // interpolation weights

  constructor(
    readonly nodes: Nodes,
    moved_mm: Float32Array,
    isEmptyAt: (p: Vec3) => boolean,
  ) {
    this.patientFromNode = invert(nodes.nodeFromPatient);
    this.mm = this.extrapolated(moved_mm, isEmptyAt);
  }

  /**
   * Extrapolates displacements into empty nodes next to tissue; otherwise interpolation would stretch the cells at the
   * surface, and dents would be too shallow.
   */
  private extrapolated(moved: Float32Array, isEmptyAt: (p: Vec3) => boolean): Float32Array {
    const { dims } = this.nodes;
    const mm = Float32Array.from(moved);
    const strides = [1, dims[0], dims[0] * dims[1]];
    const whole = new Float32Array(moved); // not attenuated from layer to layer
    const known = new Uint8Array(moved.length / 3);
    for (let n = 0; n < known.length; n++)
      known[n] = Number(moved[3 * n] !== 0 || moved[3 * n + 1] !== 0 || moved[3 * n + 2] !== 0);
    let edge = [...known.keys()].filter((n) => known[n] === 1);
    const asked = new Uint8Array(known.length); // cache of isEmptyAt: 1 empty, 2 occupied
    for (let layer = 0; layer < EMPTY_LAYERS; layer++) {
      const next: number[] = [];
      const sums = new Map<number, [number, number, number, number]>();
      for (const n of edge) {
        const at = [n % dims[0], Math.floor(n / dims[0]) % dims[1], Math.floor(n / strides[2]!)];
        for (let c = 0; c < 27; c++) {
          const by = [(c % 3) - 1, (Math.floor(c / 3) % 3) - 1, Math.floor(c / 9) - 1];
          if (by.some((d, axis) => at[axis]! + d < 0 || at[axis]! + d >= dims[axis]!)) continue;
          const m = n + by[0]! + by[1]! * strides[1]! + by[2]! * strides[2]!;
          if (known[m] === 1) continue;
          asked[m] ||= isEmptyAt(apply(this.patientFromNode, [at[0]! + by[0]!, at[1]! + by[1]!, at[2]! + by[2]!]))
            ? 1
            : 2;
          if (asked[m] === 2) continue;
          let sum = sums.get(m);
          if (!sum) {
            sums.set(m, (sum = [0, 0, 0, 0]));
            next.push(m);
          }
          for (let a = 0; a < 3; a++) sum[a]! += whole[3 * n + a]!;
          sum[3] += 1;
        }
      }
      const fraction = 1 - layer / EMPTY_LAYERS;
      for (const [m, sum] of sums) {
        known[m] = 1;
        for (let a = 0; a < 3; a++) {
          whole[3 * m + a] = sum[a]! / sum[3];
          mm[3 * m + a] = fraction * whole[3 * m + a]!;
        }
      }
      edge = next;
    }
    return mm;
  }

  /** Adds the displacement at a position at rest, patient frame, to `to`; beyond the grid it fades to zero. */
  addAt(x: number, y: number, z: number, to: Float64Array): void {
    const { dims, nodeFromPatient: m } = this.nodes;
    let fraction = 1;
    const { low, weights } = this;
    for (let axis = 0; axis < 3; axis++) {
      const row = m[axis]!;
      const node = row[0]! * x + row[1]! * y + row[2]! * z + row[3]!;
      const last = dims[axis]! - 1;
      const beyond = Math.max(-node, node - last, 0) / FADE_NODES;
      if (beyond >= 1) return;
      fraction *= 1 - beyond;
      const within = Math.min(Math.max(node, 0), last);
      low[axis] = Math.min(Math.floor(within), last - 1);
      weights[axis] = within - low[axis]!;
    }
    const first = low[0]! + dims[0] * (low[1]! + dims[1] * low[2]!);
    for (let c = 0; c < 8; c++) {
      const i = c & 1,
        j = (c >> 1) & 1,
        k = c >> 2;
      const weight =
        fraction *
        (i ? weights[0]! : 1 - weights[0]!) *
        (j ? weights[1]! : 1 - weights[1]!) *
        (k ? weights[2]! : 1 - weights[2]!);
      const n = 3 * (first + i + dims[0] * (j + dims[1] * k));
      to[0]! += weight * this.mm[n]!;
      to[1]! += weight * this.mm[n + 1]!;
      to[2]! += weight * this.mm[n + 2]!;
    }
  }
  /** Whether a position is at least half a cell inside the reported grid, where strain is known. */
  hasStrainAt(x: number, y: number, z: number): boolean {
    const { dims, nodeFromPatient: m } = this.nodes;
    for (let axis = 0; axis < 3; axis++) {
      const row = m[axis]!;
      const node = row[0]! * x + row[1]! * y + row[2]! * z + row[3]!;
      if (!(node > 0.5 && node < dims[axis]! - 1.5)) return false;
    }
    return true;
  }
}

/** Deformation by all devices, from the latest report of each. */
export class Deformation {
  private readonly latest: (DeformationMessage | undefined)[] = [];
  private fields: Field[] = []; // fields of the latest call of displaced()

  receive(received: DeformationMessage): void {
    this.latest[received.device] = received;
  }
  /** Discards everything; each connection reports again in full. */
  forget(): void {
    this.latest.length = 0;
    this.fields = [];
  }

  /** Displacement at a position at rest, by the fields of the latest call of displaced(); patient frame, mm. */
  displacementAt([x, y, z]: Vec3): Vec3 {
    const moved = new Float64Array(3);
    for (const field of this.fields) field.addAt(x, y, z, moved);
    return [moved[0]!, moved[1]!, moved[2]!];
  }

  /**
   * Inverse displacement of all devices on one grid. Contributions of devices are superposed, as in linear elasticity.
   * Four components per node: displacement, and 1 if the strain is known. The size of the grid is constant while the
   * sizes and relative positions of the reported grids are.
   * @param isEmptyAt  whether a position, patient frame, is free of tissue
   * @returns null without deformation
   */
  displaced(isEmptyAt: (p: Vec3) => boolean): { nodes: Nodes; mm: Float32Array<ArrayBuffer> } | null {
    const fields = this.latest.flatMap((one) => (one?.nodes ? [new Field(one.nodes, one.moved_mm, isEmptyAt)] : []));
    this.fields = fields;
    if (fields.length === 0) return null;
    const nodes = nodesAround(fields);
    const { dims } = nodes;
    const mm = new Float32Array(4 * dims[0] * dims[1] * dims[2]);
    const patientFromNode = invert(nodes.nodeFromPatient);
    const right = column(patientFromNode, 0);
    const moved = new Float64Array(3);
    // scalars, because allocations of vectors would dominate the computing time
    for (let k = 0, n = 0; k < dims[2]; k++)
      for (let j = 0; j < dims[1]; j++) {
        let [x, y, z] = apply(patientFromNode, [0, j, k]);
        for (let i = 0; i < dims[0]; i++, n += 4, x += right[0], y += right[1], z += right[2]) {
          // fixed-point iteration for the position at rest
          let a = x,
            b = y,
            c = z;
          for (let iteration = 0; iteration < MAX_ITERATIONS; iteration++) {
            moved.fill(0);
            for (const field of fields) field.addAt(a, b, c, moved);
            const offA = x - moved[0]! - a,
              offB = y - moved[1]! - b,
              offC = z - moved[2]! - c;
            // a full step at first, half a step once the iteration oscillates
            const fraction = iteration < 4 ? 1 : 0.5;
            a += fraction * offA;
            b += fraction * offB;
            c += fraction * offC;
            if (Math.abs(offA) + Math.abs(offB) + Math.abs(offC) < TOLERANCE_MM) break;
          }
          mm[n] = a - x;
          mm[n + 1] = b - y;
          mm[n + 2] = c - z;
          for (const field of fields) if (field.hasStrainAt(x, y, z)) mm[n + 3] = 1;
        }
      }
    return { nodes, mm };
  }
}

/** Grid, aligned with the first field's, that contains all fields' grids and their margins. */
function nodesAround(fields: Field[]): Nodes {
  const { nodeFromPatient } = fields[0]!.nodes;
  const least: Vec3 = [Infinity, Infinity, Infinity],
    most: Vec3 = [-Infinity, -Infinity, -Infinity];
  for (const {
    nodes: { dims },
    patientFromNode,
  } of fields)
    for (let corner = 0; corner < 8; corner++) {
      const at = dims.map((count, axis) => ((corner >> axis) & 1 ? count - 1 + FADE_NODES : -FADE_NODES)) as Vec3;
      apply(nodeFromPatient, apply(patientFromNode, at)).forEach((x, axis) => {
        least[axis] = Math.min(least[axis]!, x);
        most[axis] = Math.max(most[axis]!, x);
      });
    }
  // spacing of the first grid, or coarser to stay below MAX_INVERSE_NODES
  const first = least.map((x) => Math.floor(x + 1e-3)) as Vec3;
  const dimsBy = (step: number) =>
    first.map((x, axis) => Math.max(2, Math.ceil((most[axis]! - x) / step - 1e-3) + 1)) as Vec3;
  let step = 1;
  while (dimsBy(step).reduce((a, b) => a * b) > MAX_INVERSE_NODES) step *= 1.1;
  const rows = [0, 1, 2].map((r) => {
    const [a, b, c, d] = nodeFromPatient[r]! as [number, number, number, number];
    return [a / step, b / step, c / step, (d - first[r]!) / step];
  });
  return { dims: dimsBy(step), nodeFromPatient: [...rows, [0, 0, 0, 1]] };
}
