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
interface Entry extends Step<unknown> {
  key: string;
  gesture: number;
}
/** Undoable part of the view: how to read and to restore its state. */
interface UndoablePart {
  get(): unknown;
  set(to: unknown): void;
}
type ViewSnapshot = Map<string, unknown>; // states of the parts, by name

const areSame = (a: unknown, b: unknown): boolean => JSON.stringify(a) === JSON.stringify(b);

const MAX_STEPS = 200;

export class History {
  /** Number of the current gesture, such as a slider movement; steps with equal key and gesture are merged. */
  gesture = 0;
  readonly canUndo = signal(false);
  readonly canRedo = signal(false);
  private past: Entry[] = [];
  private future: Entry[] = [];
  private isBusy = false;
  private readonly parts = new Map<string, UndoablePart>();

  /** Registers a part of the view that `change` may modify. */
  register<State>(name: string, get: () => State, set: (to: State) => void): void {
    this.parts.set(name, { get, set: set as UndoablePart["set"] });
  }
  /**
   * Modifies the view; the parts that differ afterwards form the undo step.
   * @param gesture  changes with equal `by` and gesture are one step
   */
  change(by: string, act: () => void, gesture = ++this.gesture): void {
    const snapshot = () => new Map([...this.parts].map(([name, { get }]) => [name, get()]));
    const before = snapshot();
    act();
    const after = snapshot();
    for (const name of this.parts.keys()) {
      if (!areSame(before.get(name), after.get(name))) continue;
      before.delete(name);
      after.delete(name);
    }
    const apply = (_: ViewSnapshot, to: ViewSnapshot) => {
      for (const [name, state] of to) this.parts.get(name)!.set(state);
      return true;
    };
    if (after.size > 0) this.push(`${by}: ${[...after.keys()]}`, { before, after, apply }, gesture);
  }

  push<State>(key: string, step: Step<State>, gesture = this.gesture): void {
    const last = this.past.at(-1);
    if (last?.key === key && last.gesture === gesture) last.after = step.after;
    else this.past.push({ ...(step as Step<unknown>), key, gesture });
    this.past.splice(0, this.past.length - MAX_STEPS);
    this.future = [];
    this.updateSignals();
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
    this.updateSignals();
  }

  private updateSignals(): void {
    this.canUndo.value = this.past.length > 0;
    this.canRedo.value = this.future.length > 0;
  }
  /** Undoes or redoes one step; ignored while another one is pending, because the loop responds asynchronously. */
  private async move(from: Entry[], to: Entry[], apply: (step: Entry) => boolean | Promise<boolean>): Promise<void> {
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
    this.updateSignals();
  }
}
