// Actions that are due again when a signal has changed, at a time of the caller's choice, such as the next frame.

import { effect } from "@preact/signals-core";

/** Runs an action, and reports when a signal that the latest run has read changes. */
export class Watch {
  /** Whether the action has not run yet, has failed, or a signal has changed since its latest run began. */
  isDue = true;
  private forget: () => void = () => {};

  run(act: () => void): void {
    this.forget();
    this.isDue = true;
    let isFirst = true,
      isChanged = false;
    this.forget = effect(() => {
      if (isFirst) {
        isFirst = false;
        act();
      } else this.isDue = isChanged = true;
    });
    this.isDue = isChanged;
  }
}
