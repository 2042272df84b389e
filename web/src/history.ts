// What was done here, to be undone and done again: settings of the loop, turns, looks, views, measures, bookmarks. A stop, a pause and a rearm are never among it.

/** From one state of something to another. */
export interface Step<State> {
  before: State;
  after: State;
  /** @returns whether it was done; what was refused can be tried again */
  go(from: State, to: State): boolean | Promise<boolean>;
}
interface Kept extends Step<unknown> { key: string; gesture: number }

const MOST = 200;

export class History {
  /** Goes up with the end of each movement of a slider: what has one key and one gesture is one step. */
  gesture = 0;
  onChange: () => void = () => {};
  private past: Kept[] = [];
  private future: Kept[] = [];
  private isBusy = false;

  note<State>(key: string, step: Step<State>, gesture = this.gesture): void {
    const last = this.past.at(-1);
    if (last?.key === key && last.gesture === gesture) last.after = step.after;
    else this.past.push({ ...(step as Step<unknown>), key, gesture });
    this.past.splice(0, this.past.length - MOST);
    this.future = [];
    this.onChange();
  }

  get canUndo(): boolean {
    return this.past.length > 0;
  }
  get canRedo(): boolean {
    return this.future.length > 0;
  }
  undo(): Promise<void> {
    return this.move(this.past, this.future, (step) => step.go(step.after, step.before));
  }
  redo(): Promise<void> {
    return this.move(this.future, this.past, (step) => step.go(step.before, step.after));
  }
  clear(): void {
    this.past = [];
    this.future = [];
    this.onChange();
  }

  /** One at a time, for the loop answers later. */
  private async move(from: Kept[], to: Kept[], go: (step: Kept) => boolean | Promise<boolean>): Promise<void> {
    const step = from.at(-1);
    if (!step || this.isBusy) return;
    this.isBusy = true;
    const isDone = await go(step);
    this.isBusy = false;
    // what was done meanwhile has left no place for it
    if (!isDone || from.at(-1) !== step || (from !== this.past && from !== this.future)) return;
    from.pop();
    // what comes next is a step of its own
    this.gesture += 1;
    to.push(step);
    this.onChange();
  }
}
