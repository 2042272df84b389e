// Undo and redo of loop settings, rotations, looks, views, measures and bookmarks. Stops, pauses and rearms are never
// undoable.

import { signal } from "@preact/signals-core";

/** Transition between two states. */
export interface Step<State> {
  before: State;
  after: State;
  /** @returns whether it succeeded; a refused step can be retried */
  apply(from: State, to: State): boolean | Promise<boolean>;
}
interface Kept extends Step<unknown> {
  key: string;
  gesture: number;
}
/** Undoable part of the view: how to read and to restore its state. */
interface Part {
  get(): unknown;
  set(to: unknown): void;
}
type BookmarkedView = Map<string, unknown>; // states of the parts, by name

const areSame = (a: unknown, b: unknown): boolean => JSON.stringify(a) === JSON.stringify(b);

const MOST = 200;

export class History {
  /** Number of the current gesture, such as a slider movement; steps with equal key and gesture are merged. */
  gesture = 0;
  readonly canUndo = signal(false);
  readonly canRedo = signal(false);
  private past: Kept[] = [];
  private future: Kept[] = [];
  private isBusy = false;
  private readonly parts = new Map<string, Part>();

  /** Registers a part of the view that `change` may modify. */
  part<State>(name: string, get: () => State, set: (to: State) => void): void {
    this.parts.set(name, { get, set: set as Part["set"] });
  }
  /**
   * Modifies the view; the parts that differ afterwards form the undo step.
   * @param gesture  changes with equal `by` and gesture are one step
   */
  change(by: string, act: () => void, gesture = ++this.gesture): void {
    const seen = () => new Map([...this.parts].map(([name, { get }]) => [name, get()]));
    const before = seen();
    act();
    const after = seen();
    for (const name of this.parts.keys()) {
      if (!areSame(before.get(name), after.get(name))) continue;
      before.delete(name);
      after.delete(name);
    }
    const apply = (_: BookmarkedView, to: BookmarkedView) => {
      for (const [name, state] of to) this.parts.get(name)!.set(state);
      return true;
    };
    if (after.size > 0) this.note(`${by}: ${[...after.keys()]}`, { before, after, apply }, gesture);
  }

  note<State>(key: string, step: Step<State>, gesture = this.gesture): void {
    const last = this.past.at(-1);
    if (last?.key === key && last.gesture === gesture) last.after = step.after;
    else this.past.push({ ...(step as Step<unknown>), key, gesture });
    this.past.splice(0, this.past.length - MOST);
    this.future = [];
    this.count();
  }

  undo(): Promise<void> {
    return this.move(this.past, this.future, (step) => step.apply(step.after, step.before));
  }
  redo(): Promise<void> {
    return this.move(this.future, this.past, (step) => step.apply(step.before, step.after));
  }
  clear(): void {
    this.past = [];
    this.future = [];
    this.count();
  }

  private count(): void {
    this.canUndo.value = this.past.length > 0;
    this.canRedo.value = this.future.length > 0;
  }
  /** Undoes or redoes one step; ignored while another one is pending, because the loop responds asynchronously. */
  private async move(from: Kept[], to: Kept[], apply: (step: Kept) => boolean | Promise<boolean>): Promise<void> {
    const step = from.at(-1);
    if (!step || this.isBusy) return;
    this.isBusy = true;
    const isDone = await apply(step);
    this.isBusy = false;
    // the step was refused, or the history has changed meanwhile
    if (!isDone || from.at(-1) !== step || (from !== this.past && from !== this.future)) return;
    from.pop();
    // the next change is a step of its own
    this.gesture += 1;
    to.push(step);
    this.count();
  }
}
