// Distances of tools to structures and to the borders of no-go regions, as figures, text and sound.

import { effect } from "@preact/signals-core";
import type { Rgb } from "../protocol/messages.js";
import { ApproachSound } from "./approach_sound.js";
import type { Connection } from "../protocol/connection.js";
import { byId, element, press, write } from "../base/dom.js";
import { quantity } from "../words/figures.js";
import { store, recall } from "../state/local_storage.js";
import type { StructureDistance } from "../protocol/distances.js";
import { PAGE_KEY, type StoredPage, type Session } from "../state/session.js";
import { words } from "../words/words.js";

/** Minimum interval between changes of the text, which screen readers announce. */
const MIN_WORDS_MS = 1000;
const css = ([r, g, b]: Rgb): string => `rgb(${r} ${g} ${b})`;

export class NearPanel {
  readonly approachSound = new ApproachSound();
  private textUpdated_ms = -Infinity;

  constructor(
    private readonly session: Session,
    private readonly connection: Connection,
  ) {
    effect(() => {
      const scene = session.scene.value;
      byId("near-card").hidden = !this.isReported;
      byId("sound").hidden = !scene || scene.no_go.length === 0;
      byId("near-lists").hidden = !scene?.distances;
    });
    this.approachSound.switch(recall<StoredPage>(PAGE_KEY).sound === true);
    byId("sound").addEventListener("click", () => this.toggleSound());
    // browsers block sound before a user gesture
    for (const event of ["pointerdown", "keydown"])
      document.addEventListener(event, () => this.approachSound.wake(), { capture: true });
    effect(() => this.updateSound());
    session.onFigures((now_ms) => this.draw(now_ms));
  }

  /** Whether the session reports distances to structures or has no-go regions. */
  private get isReported(): boolean {
    const scene = this.session.scene.value;
    return scene !== null && (scene.distances !== null || scene.no_go.length > 0);
  }

  toggleSound(): void {
    if (byId("sound").hidden || byId("near-card").hidden) return;
    this.approachSound.switch(!this.approachSound.isOn);
    this.approachSound.wake();
    store<StoredPage>(PAGE_KEY, { sound: this.approachSound.isOn });
    this.updateSound();
    this.draw(performance.now());
  }
  /** Updates the sound: silent while the force is stopped, in a paused recording, and without a connection. */
  updateSound(): void {
    const pose = this.session.pose.value,
      state = this.session.state.value,
      approach = this.session.approach.value;
    const isSilent =
      !pose ||
      !state ||
      state.stop !== null ||
      state.playback?.playing === false ||
      this.connection.link.value !== "connected";
    this.approachSound.update(isSilent ? null : (approach?.mm ?? null));
  }

  private draw(now: number): void {
    if (!this.isReported) return;
    const { session } = this;
    press(byId("sound"), this.approachSound.isOn);
    const approach = session.approach.value;
    const line = byId("no-go");
    line.classList.toggle("damage", approach?.pushes === true);
    write(line, this.approachText());
    byId("sound-held").hidden = !this.approachSound.isBlocked;
    const device = session.pose.value?.devices[0];
    const near = device ? session.nearTo(device) : [];
    this.drawRows(near);
    byId("near-none").hidden = near.length > 0;
    if (session.scene.value!.distances)
      write(byId("near-none"), words.nothingNear(quantity(session.scene.value!.distances.reach_mm, "mm")));
    if (now - this.textUpdated_ms < MIN_WORDS_MS) return;
    this.textUpdated_ms = now;
    const spoken = byId("near-words");
    // a live region while the sound is on, else only displayed
    spoken.ariaLive = this.approachSound.isOn ? "polite" : "off";
    write(
      spoken,
      near
        .slice(0, 1)
        .map(({ label, mm }) =>
          (mm < 0 ? words.insideInWords : words.nearInWords)(this.session.nameOf(label), Math.abs(mm).toFixed(0)),
        )
        .join(),
    );
  }

  private approachText(): string {
    const approach = this.session.approach.value;
    if (!approach) return "";
    const name = this.session.regionName(approach.region);
    if (!approach.pushes) return words.beforeRegion(name, quantity(approach.mm, "mm"));
    const force_N = Math.max(
      ...this.session.near.value.map(({ noGo, force }) => (noGo === approach.region ? force : 0)),
    );
    return `⚠ ${words.tooNear(name, quantity(-approach.mm, "mm"))} · ${words.pushesBy(quantity(force_N, "N"))}`;
  }

  private drawRows(near: StructureDistance[]): void {
    const scene = this.session.scene.value,
      pushing = this.session.pushing.value;
    const rows = byId<HTMLTableElement>("near").tBodies[0]!;
    while (rows.rows.length < near.length)
      rows.append(
        element(
          "tr",
          {},
          element("th", { scope: "row" }, element("span", { className: "swatch" }), element("span")),
          element("td"),
        ),
      );
    for (const [n, row] of [...rows.rows].entries()) {
      const one = near[n];
      row.hidden = one === undefined;
      if (!one) continue;
      const index = scene!.structures.findIndex(({ label }) => label === one.label);
      const [swatch, name] = row.cells[0]!.children as unknown as [HTMLElement, HTMLElement];
      swatch.style.background = css(this.session.appearances.value[index]?.colour ?? [128, 128, 128]);
      const regions = scene!.no_go.filter(({ label }) => label === one.label);
      write(
        name,
        this.session.nameOf(one.label) +
          regions
            .slice(0, 1)
            .map(({ keep_away_mm }) => ` · ${words.keepAway(quantity(keep_away_mm, "mm"))}`)
            .join(""),
      );
      write(row.cells[1]!, quantity(one.mm, "mm"));
      row.classList.toggle("pushes", pushing !== null && regions.includes(scene!.no_go[pushing.region]!));
    }
  }
}
