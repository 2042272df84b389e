// How wrong the place may be at which a tracked tool's tip is shown, as palpate tells it (docs/reference/viewer-messages.md).

import { byId, write } from "./dom.js";
import { words } from "./words.js";

/** Lengths in mm. */
export interface Tracked {
  device: number; // whose tip
  seen: boolean; // else it is where the tracker saw it last
  fre_mm: number; // left over at the points
  tre_mm: number | null; // root of the mean square; null: nothing is known of it
  tre_95_mm: number | null; // 95 of 100 errors are below
  far: boolean; // far outside the points that were touched
}

export function trackedText(tracked: Tracked): string {
  // to tenths, as what is foretold is not known better
  const mm = (value: number): string => `${value.toFixed(1)} mm`;
  const { tre_mm, tre_95_mm } = tracked;
  return [
    ...(tracked.seen ? [] : [words.toolNotSeen]),
    tre_mm === null || tre_95_mm === null ? words.treNotKnown : words.treIs(mm(tre_mm), mm(tre_95_mm)),
    words.freIs(mm(tracked.fre_mm)),
    ...(tracked.far ? [words.farFromPoints] : []),
  ].join(" · ");
}

/** Of a session without a tracked tool: null. */
export function showTracked(tracked: Tracked | null): void {
  const line = byId("tracked");
  line.hidden = tracked === null;
  if (!tracked) return;
  write(line, trackedText(tracked));
  line.classList.toggle("doubtful", tracked.far || !tracked.seen);
}
