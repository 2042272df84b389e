// Loss of graphics: lost WebGL contexts and a failed worker. Losses are reported on the page and restored as
// soon as the browser permits.

import { effect, signal } from "@preact/signals-core";
import { showError } from "../base/announce.js";
import { byId, write } from "../base/dom.js";
import type { AnySlicer } from "../section/slicer.js";
import type { Session } from "../state/session.js";
import type { VolumeRenderer } from "../volume/volume_renderer.js";
import { words } from "../words/words.js";

/** Time after which a lost WebGL context that the browser has not restored is reported as permanent. */
const RESTORE_TIMEOUT_MS = 5000;

type Which = "sections" | "volume";
type Condition = "fine" | "lost" | "restorable";

export class Graphics {
  private readonly condition = {
    sections: signal<Condition>("fine"),
    volume: signal<Condition>("fine"),
  };
  private readonly failed = signal<"no" | "once" | "again">("no"); // failures of the volume's worker
  private readonly hasTimedOut = signal(false); // lost graphics are reported as permanent
  private restoreTimer = 0; // timer of RESTORE_TIMEOUT_MS
  private isRestoring = false;

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
        void this.restoreContexts();
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
    void this.restoreContexts();
  }
  private lost(which: Which): void {
    this.condition[which].value = "lost";
    if (which === "volume") this.onVolumeLost();
    this.redraw();
    clearTimeout(this.restoreTimer);
    this.hasTimedOut.value = false;
    this.restoreTimer = window.setTimeout(() => (this.hasTimedOut.value = true), RESTORE_TIMEOUT_MS);
  }
  /** Redraws the sections, which are empty without a context. */
  private redraw(): void {
    this.session.edits.value += 1;
  }

  /** Uploads everything to restored contexts; sections first, because they show the tip's position. */
  private async restoreContexts(): Promise<void> {
    if (this.isRestoring) return;
    this.isRestoring = true;
    const { sections, volume } = this.condition;
    try {
      while (await this.restoreNext());
    } catch (error) {
      showError(error);
    }
    this.isRestoring = false;
    if (sections.value !== "fine" || volume.value !== "fine") return;
    clearTimeout(this.restoreTimer);
    this.hasTimedOut.value = false;
  }
  /** @returns whether something was restored */
  private async restoreNext(): Promise<boolean> {
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
    const areSectionsLost = sections.value !== "fine",
      isVolumeLost = volume.value !== "fine" && failed === "no";
    const lostText =
      areSectionsLost && isVolumeLost
        ? words.lostBoth
        : areSectionsLost
          ? words.lostSections
          : isVolumeLost
            ? words.lostVolume
            : null;
    const all = [
      ...(lostText === null ? [] : [lostText, this.hasTimedOut.value ? words.remedyLost : words.lostRecovery]),
      ...(failed === "no" ? [] : [words.failedVolume, failed === "once" ? words.failedRecovery : words.remedyFailed]),
    ];
    return all.length === 0 ? "" : [...all, words.lostScope].join(" ");
  }
}
