// Changes of displayed voxels: burr cuts, structures that a quiz hides, and deformation of soft tissue.

import { showError } from "../base/announce.js";
import type { Vec3 } from "../base/geometry.js";
import { Displacement } from "../drawing/displacement.js";
import type { Scene, Sweep } from "../protocol/messages.js";
import type { Nodes, DeformationMessage } from "../protocol/deformation_message.js";
import type { AnySlicer } from "../section/slicer.js";
import type { Session } from "../state/session.js";
import type { Redacted } from "../training/redaction.js";
import type { VolumeRenderer } from "../volume/volume_renderer.js";
import type { VolumeView } from "../volume/volume_view.js";
import { LazyModule } from "../words/lazy_module.js";

/** Whether voxels can be removed, indexed by the structure's index + 1. */
const removable = ({ structures, tissues }: Scene): boolean[] => [
  false,
  ...structures.map(({ tissue }) => {
    const of = tissues[tissue];
    return of !== undefined && of.touchable && of.protection !== "keep";
  }),
];

export class VoxelChanges {
  private readonly cuts = new LazyModule("cuts", async () => new (await import("../state/cuts.js")).Cuts());
  private readonly deformation = new LazyModule(
    "deformation",
    async () => new (await import("../state/deformation.js")).Deformation(),
  );
  // reports that are not applied yet
  private sweeps: [first: number, sweeps: Sweep[]][] = [];
  private receivedDeformations: DeformationMessage[] = [];
  private displacement: Displacement | null = null; // as displayed
  private isDeformationDue = false; // deformation has changed since it was last displayed
  private isDeforming = false; // the volume's renderer is receiving a deformation
  private changing: Promise<void> = Promise.resolve(); // changes of voxels, one at a time
  private hidden = ""; // key of the labels that a quiz hides
  private redacted: Redacted | null = null;

  constructor(
    private readonly session: Session,
    private readonly slicer: AnySlicer,
    private readonly renderer: VolumeRenderer,
    private readonly volume: VolumeView,
  ) {}

  /** Discards what the previous connection has reported; each connection reports in full. */
  reset(): void {
    this.reportCut(0, []);
    this.receivedDeformations = [];
    this.deformation.value?.forget();
    this.isDeformationDue = true;
  }
  /** Discards state of another patient's volumes, and applies to the current ones what was reported. */
  volumesChanged(): void {
    this.redacted = null;
    this.hidden = "";
    this.displace(null);
    this.isDeformationDue = true;
    this.cut();
  }

  // ---- voxels

  /** Replaces the structures in a box of voxels, i fastest: index in the scene's list + 1, or 0. */
  async updateBox(lo: Vec3, size: Vec3, structure: Uint8Array): Promise<void> {
    this.session.volumes.value!.write(lo, size, structure);
    await this.showBox(lo, size);
  }
  private async showBox(lo: Vec3, size: Vec3): Promise<void> {
    this.volume.voxelsChanged();
    await Promise.all([this.slicer.update(lo, size), this.renderer.update(lo, size)]);
    this.session.edits.value += 1;
  }
  /** Performs a change after all earlier ones. */
  private then(change: () => Promise<unknown>): void {
    this.changing = this.changing.then(async () => void (await change())).catch(showError);
  }

  /** Takes over burr sweeps, which replace all from number `first` on. */
  reportCut(first: number, sweeps: Sweep[]): void {
    this.sweeps.push([first, sweeps]);
    this.cut();
  }
  /** Applies sweeps and their undo; those that arrive meanwhile are part of the same update. */
  private cut(): void {
    this.then(async () => {
      const cuts = this.sweeps.some(([, { length }]) => length > 0) ? await this.cuts.get() : this.cuts.value;
      for (const report of this.sweeps.splice(0)) cuts?.receive(...report);
      const volumes = this.session.volumes.value,
        scene = this.session.scene.value;
      const box = volumes && scene && cuts?.applyTo(volumes, removable(scene));
      if (box) await this.showBox(box.lo, box.size);
    });
  }

  /** Hides the names of structures, and the voxels of labels to be found in a quiz; null: restores both. */
  hide(toFind: number[] | null, { redact, revealed }: typeof import("../training/redaction.js")): void {
    const { session } = this;
    const hidden = JSON.stringify(toFind);
    if (hidden === this.hidden || !session.volumes.value || !session.scene.value) return;
    this.hidden = hidden;
    session.quiz.value = toFind;
    document.body.classList.toggle("quiz", toFind !== null);
    this.then(async () => {
      const volumes = session.volumes.value,
        scene = session.scene.value;
      if (!volumes || !scene || hidden !== this.hidden) return;
      if (this.redacted) await this.updateBox(this.redacted.lo, this.redacted.size, revealed(volumes, this.redacted));
      this.redacted = toFind && toFind.length > 0 ? redact(scene, volumes, toFind) : null;
      session.concealment.value = this.redacted;
      if (this.redacted) await this.updateBox(this.redacted.lo, this.redacted.size, this.redacted.now);
    });
  }

  // ---- deformation

  addDeformation(received: DeformationMessage): void {
    this.receivedDeformations.push(received);
    this.isDeformationDue = true;
  }
  /** Displays the latest deformation, if it has changed; to be called for every frame. */
  showDeformation(): void {
    if (this.isDeformationDue && !this.isDeforming) void this.deform();
  }
  private async deform(): Promise<void> {
    const volumes = this.session.volumes.value;
    if (!volumes) return;
    this.isDeformationDue = false;
    this.isDeforming = true;
    const deformation = this.receivedDeformations.some(({ nodes }) => nodes)
      ? await this.deformation.get()
      : this.deformation.value;
    for (const received of this.receivedDeformations.splice(0)) deformation?.receive(received);
    const by = deformation?.displaced((p) => volumes.structureAt(p) === null);
    if (by || this.displacement) await this.displaceBy(by ? new Displacement(by.nodes, by.mm) : null);
    this.isDeforming = false;
  }
  /**
   * Displays a deformation, initially zero, on a grid of nodes; null: none. It affects pictures only; contact and
   * readouts use undeformed voxels.
   */
  displace(nodes: Nodes | null): void {
    void this.displaceBy(nodes && new Displacement(nodes));
  }
  private async displaceBy(displacement: Displacement | null): Promise<void> {
    const { session } = this;
    this.displacement = displacement;
    session.isDeformed.value = displacement !== null;
    session.displacementAt.value = (position) => this.deformation.value?.displacementAt(position) ?? [0, 0, 0];
    this.slicer.displace(displacement);
    const isThere = this.renderer.displace(displacement);
    session.edits.value += 1;
    await isThere;
  }
  /**
   * Replaces displacements of a box of nodes.
   * @param mm  from displayed positions to positions at rest, patient frame; three components per node, i fastest
   */
  async updateDisplacement(lo: Vec3, size: Vec3, mm: ArrayLike<number>): Promise<void> {
    this.displacement!.write(lo, size, mm);
    this.slicer.updateDisplacement(lo, size);
    await this.renderer.updateDisplacement(lo, size);
    this.session.edits.value += 1;
  }
}
