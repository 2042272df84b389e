// Edits of the plan. If palpate has a plan that this viewer may edit, edits are requests and apply to all viewers;
// otherwise the page has its own plan, which can be downloaded.

import { batch, signal } from "@preact/signals-core";
import type { Plan, Trajectory } from "../protocol/messages.js";
import { add, length, normalize, scale, sub, type Vec3 } from "../base/geometry.js";
import type { History } from "./history.js";
import { words } from "../words/words.js";

/** Length of a new trajectory, towards the centre of the volume. */
const NEW_MM = 20;
/** Pick radius of trajectory ends; CSS pixels. */
const PICK_RADIUS_PX = 14;
/** Minimum drag distance that places the target of a new trajectory; CSS pixels. */
const MIN_DRAG_PX = 6;
const NO_BOUNDS = { entry_within_mm: null, target_within_mm: null, angle_within_deg: null, depth_within_mm: null };

export type End = "entry_mm" | "target_mm";
/** Distance, CSS pixels, between a press and the projection of a position. */
type PixelsTo = (p: Vec3) => number;

export class PlanStore {
  /** Index of the edited trajectory; -1: none. */
  readonly chosen = signal(-1);
  private readonly published = signal<Plan | null>(null); // palpate's plan
  private readonly own = signal<Plan | null>(null); // this page's plan
  private readonly draftEntry = signal<Vec3 | null>(null); // entry of a new trajectory that still lacks a target
  private readonly draggedEnd = signal<{ index: number; end: End; to: Vec3 } | null>(null);

  /**
   * @param ask  requests a change of palpate's plan
   * @param mayAsk  whether this viewer may edit it
   */
  constructor(
    private readonly history: History,
    private readonly ask: (request: Record<string, unknown>) => Promise<boolean>,
    private readonly mayAsk: () => boolean,
  ) {}

  /** Whether edits apply to palpate's plan. */
  get isShared(): boolean {
    return this.published.value?.can_change === true && this.mayAsk();
  }
  get isOwn(): boolean {
    return !this.isShared && this.own.value !== null;
  }
  /** Displayed plan; null: none. */
  get plan(): Plan | null {
    return this.isShared ? this.published.value : (this.own.value ?? this.published.value);
  }
  get list(): Trajectory[] {
    return this.plan?.trajectories ?? [];
  }
  /** Displayed trajectories, including the current position of a moved end and an incomplete trajectory. */
  get drawn(): Trajectory[] {
    const [draggedEnd, draftEntry] = [this.draggedEnd.value, this.draftEntry.value];
    const list = this.list.map((one, index) =>
      draggedEnd?.index === index ? { ...one, [draggedEnd.end]: draggedEnd.to } : one,
    );
    return draftEntry
      ? [...list, { ...NO_BOUNDS, name: words.entry, entry_mm: draftEntry, target_mm: draftEntry }]
      : list;
  }
  update(plan: Plan | null): void {
    this.change(() => (this.published.value = plan));
  }
  /** Discards the page's own plan; to be called when another scene is loaded. */
  forget(): void {
    this.change(() => {
      this.own.value = this.draftEntry.value = this.draggedEnd.value = null;
      this.chosen.value = -1;
    });
  }

  // ---- undoable edits

  replace(index: number, trajectory: Trajectory): void {
    const { name, entry_mm, target_mm } = trajectory;
    const list = this.list.slice();
    list[index] = trajectory;
    this.chosen.value = index;
    void this.edit(list, { trajectory: index, name, entry_mm, target_mm });
  }
  add(entry_mm: Vec3, target_mm: Vec3): void {
    const names = this.list.map(({ name }) => name);
    let number = names.length + 1;
    while (names.includes(words.trajectoryNumber(String(number)))) number += 1;
    this.replace(names.length, { ...NO_BOUNDS, name: words.trajectoryNumber(String(number)), entry_mm, target_mm });
  }
  /** Adds a trajectory of length NEW_MM from `entry` towards `to`. */
  addTowards(entry: Vec3, to: Vec3): void {
    const way = sub(to, entry);
    this.add(entry, add(entry, scale(length(way) > 1 ? normalize(way) : [0, 1, 0], NEW_MM)));
  }
  remove(index: number): void {
    if (this.chosen.value >= index) this.chosen.value -= 1;
    void this.edit(
      this.list.filter((_, other) => other !== index),
      { trajectory: index, remove: true },
    );
  }
  /** Requests that palpate saves the plan to its file. */
  save(): Promise<boolean> {
    return this.ask({ version: this.published.value?.version, save: true });
  }

  private async edit(trajectories: Trajectory[], request: Record<string, unknown>): Promise<void> {
    this.history.gesture += 1;
    if (!this.isShared) {
      const before = this.own.value;
      const after: Plan = {
        version: 0,
        keep_away: this.plan?.keep_away ?? [],
        saved: false,
        can_change: false,
        trajectories,
      };
      this.history.push("plan", { before, after, apply: (_, to) => this.setOwn(to) });
      this.setOwn(after);
      return;
    }
    const { version } = this.published.value!;
    if (!(await this.ask({ version, ...request }))) return;
    // palpate increments the version for every change, undo included
    this.history.push("plan", { before: version, after: version + 1, apply: (_, to) => this.goBack(to) });
  }
  private setOwn(plan: Plan | null): boolean {
    this.change(() => (this.own.value = plan));
    return true;
  }
  private goBack(version: number): boolean | Promise<boolean> {
    const published = this.published.value;
    return published !== null && this.ask({ version: published.version, back_to: version });
  }
  /** Changes the plan, and the chosen trajectory if that is gone. */
  private change(act: () => void): void {
    batch(() => {
      act();
      this.chosen.value = Math.min(this.chosen.value, this.list.length - 1);
    });
  }

  // ---- presses in pictures

  /** Handles a press: sets the target of a begun trajectory, else picks an existing end, else begins a trajectory. */
  press(at: Vec3, pixelsTo: PixelsTo): void {
    const [nearest] = this.list
      .flatMap((one, index) =>
        (["entry_mm", "target_mm"] as const).map((end) => ({ index, end, to: at, far: pixelsTo(one[end]) })),
      )
      .sort((a, b) => a.far - b.far);
    const entry = this.draftEntry.value;
    if (entry) {
      this.draftEntry.value = null;
      this.add(entry, at);
    } else if (nearest && nearest.far <= PICK_RADIUS_PX) {
      this.draggedEnd.value = nearest;
      this.chosen.value = nearest.index;
    } else this.draftEntry.value = at;
  }
  move(at: Vec3): void {
    if (this.draggedEnd.value) this.draggedEnd.value = { ...this.draggedEnd.value, to: at };
  }
  release(at: Vec3, pixelsTo: PixelsTo): void {
    const [draggedEnd, draftEntry] = [this.draggedEnd.value, this.draftEntry.value];
    this.draggedEnd.value = null;
    if (draggedEnd) {
      const one = this.list[draggedEnd.index];
      if (one && length(sub(one[draggedEnd.end], draggedEnd.to)) > 0 && pixelsTo(one[draggedEnd.end]) > MIN_DRAG_PX)
        this.replace(draggedEnd.index, { ...one, [draggedEnd.end]: draggedEnd.to });
    } else if (draftEntry && pixelsTo(draftEntry) > MIN_DRAG_PX) {
      this.draftEntry.value = null;
      this.add(draftEntry, at);
    }
  }
  /** Abandons a trajectory without a target, and the movement of an end. */
  drop(): void {
    this.draftEntry.value = this.draggedEnd.value = null;
  }
}
