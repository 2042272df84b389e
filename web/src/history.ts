// What was done here, to be undone and done again: settings of the loop, turns, looks, what is seen and from where, measures, bookmarks. A stop, a pause and a rearm are never among it.

/** From one state of something to another. */
export interface Step<State> {
  before: State;
  after: State;
  /** @returns whether it was done; what was refused can be tried again */
  go(from: State, to: State): boolean | Promise<boolean>;
}
interface Kept extends Step<unknown> { key: string; gesture: number }
/** Something of what is seen. */
interface Part { get(): unknown; set(to: unknown): void }
type Seen = Map<string, unknown>; // by the parts' names

const areSame = (a: unknown, b: unknown): boolean => JSON.stringify(a) === JSON.stringify(b);

const MOST = 200;

export class History {
  /** Goes up with the end of each movement of a slider: what has one key and one gesture is one step. */
  gesture = 0;
  onChange: () => void = () => {};
  private past: Kept[] = [];
  private future: Kept[] = [];
  private isBusy = false;
  private readonly parts = new Map<string, Part>();

  /** Something that `change` changes: how it is, and how it is brought back. */
  part<State>(name: string, get: () => State, set: (to: State) => void): void {
    this.parts.set(name, { get, set: set as Part["set"] });
  }
  /** Does what shows something else; the parts that are otherwise then are what is undone. @param gesture  what is done by one thing in one gesture is one step */
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
    const go = (_: Seen, to: Seen) => {
      for (const [name, state] of to) this.parts.get(name)!.set(state);
      return true;
    };
    if (after.size > 0) this.note(`${by}: ${[...after.keys()]}`, { before, after, go }, gesture);
  }

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
