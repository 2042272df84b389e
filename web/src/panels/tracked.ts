// Display of the registration error of a tracked tool's tip (docs/reference/viewer-messages.md).

import { effect } from "@preact/signals-core";
import type { Tracked } from "../protocol/messages.js";
import { byId, write } from "../base/dom.js";
import type { Session } from "../state/session.js";
import { words } from "../words/words.js";

export function trackedText(tracked: Tracked): string {
  // estimates are no more accurate than 0.1 mm
  const mm = (value: number): string => `${value.toFixed(1)} mm`;
  const { tre_mm, tre_95_mm } = tracked;
  return [
    ...(tracked.seen ? [] : [words.toolNotSeen]),
    tre_mm === null || tre_95_mm === null ? words.treNotKnown : words.treIs(mm(tre_mm), mm(tre_95_mm)),
    words.freIs(mm(tracked.fre_mm)),
    ...(tracked.far ? [words.farFromPoints] : []),
  ].join(" · ");
}

export function showTracked(session: Session): void {
  const line = byId("tracked");
  effect(() => {
    const tracked = session.tracked.value;
    line.hidden = tracked === null;
    if (!tracked) return;
    write(line, trackedText(tracked));
    line.classList.toggle("doubtful", tracked.far || !tracked.seen);
  });
}
