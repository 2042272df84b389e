// Frames: draws what has changed, as often as the machine permits, and updates the figures.

import { Watch } from "../base/watch.js";
import type { Connection } from "../protocol/connection.js";
import type { AnySlicer } from "../section/slicer.js";
import type { SectionView } from "../section/section_view.js";
import type { Session } from "../state/session.js";
import type { ScopeView } from "../volume/scope_view.js";
import type { VolumeRenderer } from "../volume/volume_renderer.js";
import type { VolumeView } from "../volume/volume_view.js";
import type { LazyModule } from "../words/lazy_module.js";
import { showReadout } from "../panels/readout.js";
import type { VoxelChanges } from "./voxels.js";

/** Minimum frame interval without a graphics card, which keeps the page responsive. */
const SOFTWARE_FRAME_MS = 66;
/**
 * Minimum interval between drawings of the sections, as a multiple of their duration, while the volume is rendered on
 * the same CPU: sections get a third of the time.
 */
const SECTIONS_REST = 3;
/**
 * Maximum time for which all sections together may block the page without a graphics card, and while the volume is
 * rendered, too.
 */
const SECTIONS_MS = 32,
  SECTIONS_BESIDE_MS = 16;
const FIGURES_MS = 100;

export interface FramesContext {
  session: Session;
  connection: Connection;
  slicer: AnySlicer;
  renderer: VolumeRenderer;
  volume: VolumeView;
  sections: SectionView[];
  scope: LazyModule<ScopeView>;
  voxels: VoxelChanges;
  /** Called after the first section is drawn. */
  onFirstSection(): void;
  /** Called after every frame. */
  onFrame(): void;
}

export class Frames {
  /** Minimum frame interval without a graphics card. */
  leastFrame_ms = SOFTWARE_FRAME_MS;
  hasShownSection = false;
  private readonly drawing = new Watch(); // drawing of the sections
  private appearance: Session["appearance"]["value"] | null = null; // appearance that the slicer has
  private drawn_ms = -Infinity;
  private figures_ms = -Infinity;

  constructor(private readonly context: FramesContext) {}

  begin(): void {
    const frame = (now: number) => {
      requestAnimationFrame(frame);
      this.frame(now);
    };
    requestAnimationFrame(frame);
  }

  /** Draws pictures and figures immediately, with sections at full resolution. */
  drawNow(): void {
    const { volume, scope, session } = this.context;
    this.drawSections(Infinity);
    volume.draw(performance.now());
    scope.value?.draw(performance.now());
    session.updateFigures(performance.now());
  }

  /**
   * Draws the sections and updates the readout.
   * @param max_ms  maximum time to block the page
   */
  private drawSections(max_ms: number): void {
    const { session, slicer, sections } = this.context;
    this.drawing.run(() => {
      const appearance = session.appearance.value;
      if (this.appearance !== appearance && session.volumes.value) {
        this.appearance = appearance;
        slicer.setColours(appearance.palette);
      }
      const shown = sections.filter(({ picture }) => picture.isShown).length;
      for (const section of sections) section.draw(performance.now(), max_ms / shown);
      slicer.mark();
      showReadout(session);
    });
  }

  private frame(now: number): void {
    const { session, connection, slicer, renderer, volume, scope, voxels } = this.context;
    session.isFresh.value = connection.isFresh();
    session.age_ms.value = connection.age_ms();
    voxels.showDeformation();
    if (slicer.isSoftware) {
      // sections leave time for the volume's picture, which is rendered concurrently
      const least_ms = renderer.isDrawing
        ? Math.max(this.leastFrame_ms, SECTIONS_REST * slicer.took_ms)
        : this.leastFrame_ms;
      if (!slicer.isDone || now - this.drawn_ms < least_ms) {
        // requests to the volume's renderer do not depend on the sections
        volume.requestPicture(now);
        scope.value?.requestPicture(now);
        return;
      }
      this.drawn_ms = now;
    }
    // every frame, because a sharp picture of the volume follows a pause, and the tool is drawn over each new picture
    volume.draw(now, slicer.isSoftware ? this.leastFrame_ms / 2 : 0);
    scope.value?.draw(now);
    this.drawSectionsIfDue();
    this.context.onFrame();
    if (now - this.figures_ms <= FIGURES_MS) return;
    this.figures_ms = now;
    session.updateFigures(now);
  }
  private drawSectionsIfDue(): void {
    const { session, slicer, renderer, sections, onFirstSection } = this.context;
    const isDue = this.drawing.isDue || sections.some(({ isCoarse }) => isCoarse);
    // drawing would block while the volume's shader is compiled
    if (!isDue || !session.volumes.value || renderer.isCompiling) return;
    this.drawSections(!slicer.isSoftware ? Infinity : renderer.isDrawing ? SECTIONS_BESIDE_MS : SECTIONS_MS);
    if (this.hasShownSection) return;
    this.hasShownSection = true;
    onFirstSection();
  }
}
