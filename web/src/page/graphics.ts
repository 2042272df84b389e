// Loss of graphics: contexts that the browser has taken away, and a worker that has failed. What is lost is reported on
// the page and restored when the browser permits it.

import { effect, signal } from "@preact/signals-core";
import { showError } from "../base/announce.js";
import { byId, write } from "../base/dom.js";
import type { AnySlicer } from "../section/slicer.js";
import type { Session } from "../state/session.js";
import type { VolumeRenderer } from "../volume/volume_renderer.js";
import { words } from "../words/words.js";

/** Time after which a lost WebGL context that the browser has not restored is reported as permanent. */
const HOPELESS_MS = 5000;

type Which = "sections" | "volume";
type Condition = "fine" | "lost" | "restorable";

export class Graphics {
  private readonly condition = {
    sections: signal<Condition>("fine"),
    volume: signal<Condition>("fine"),
  };
  private readonly failed = signal<"no" | "once" | "again">("no"); // failures of the volume's worker
  private readonly isHopeless = signal(false); // lost graphics are reported as permanent
  private hopeless = 0; // timer of HOPELESS_MS
  private isMending = false;

  /** @param onVolumeLost  called when the displayed pictures of the volume are lost */
  constructor(
    private readonly session: Session,
    private readonly slicer: AnySlicer,
    private readonly renderer: VolumeRenderer,
    private readonly onVolumeLost: () => void,
  ) {
    for (const [which, its] of [
      ["sections", slicer],
      ["volume", renderer],
    ] as const) {
      its.onLost = () => this.lost(which);
      its.onRestorable = () => {
        this.condition[which].value = "restorable";
        void this.mend();
      };
    }
    renderer.onFailed = (isReplaced) => this.workerFailed(isReplaced);
    effect(() => {
      const text = this.text();
      write(byId("graphics"), text);
      byId("graphics").hidden = text === "";
    });
  }

  private workerFailed(isReplaced: boolean): void {
    this.failed.value = isReplaced ? "once" : "again";
    this.condition.volume.value = isReplaced ? "restorable" : "lost";
    this.onVolumeLost();
    void this.mend();
  }
  private lost(which: Which): void {
    this.condition[which].value = "lost";
    if (which === "volume") this.onVolumeLost();
    this.redraw();
    clearTimeout(this.hopeless);
    this.isHopeless.value = false;
    this.hopeless = window.setTimeout(() => (this.isHopeless.value = true), HOPELESS_MS);
  }
  /** Redraws the sections, which are empty without a context. */
  private redraw(): void {
    this.session.edits.value += 1;
  }

  /** Uploads everything to restored contexts; sections first, because they show the tip's position. */
  private async mend(): Promise<void> {
    if (this.isMending) return;
    this.isMending = true;
    const { sections, volume } = this.condition;
    try {
      while (await this.mendOne());
    } catch (error) {
      showError(error);
    }
    this.isMending = false;
    if (sections.value !== "fine" || volume.value !== "fine") return;
    clearTimeout(this.hopeless);
    this.isHopeless.value = false;
  }
  /** @returns whether something was restored */
  private async mendOne(): Promise<boolean> {
    const { sections, volume } = this.condition;
    if (sections.value === "restorable") {
      await this.slicer.restore(this.session.volumes.value);
      if (sections.value === "restorable") sections.value = "fine";
      this.redraw();
      return true;
    }
    if (sections.value !== "fine" || volume.value !== "restorable") return false;
    if ((await this.renderer.restore()) && volume.value === "restorable") {
      volume.value = "fine";
      if (this.failed.value === "once") this.failed.value = "no";
    }
    return true;
  }

  private text(): string {
    const { sections, volume } = this.condition;
    const failed = this.failed.value;
    const areSectionsTaken = sections.value !== "fine",
      isVolumeTaken = volume.value !== "fine" && failed === "no";
    const taken =
      areSectionsTaken && isVolumeTaken
        ? words.lostBoth
        : areSectionsTaken
          ? words.lostSections
          : isVolumeTaken
            ? words.lostVolume
            : null;
    const all = [
      ...(taken === null ? [] : [taken, this.isHopeless.value ? words.mendLost : words.lostHeals]),
      ...(failed === "no" ? [] : [words.failedVolume, failed === "once" ? words.failedHeals : words.mendFailed]),
    ];
    return all.length === 0 ? "" : [...all, words.lostHarmless].join(" ");
  }
}
