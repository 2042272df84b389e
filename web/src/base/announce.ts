// Announcements to screen readers, at most one per second; messages within that interval are joined. Toasts are
// announced too.

import { byId } from "./dom.js";

const MIN_INTERVAL_MS = 1000;
let waiting: string[] = [];
let spoken_ms = -Infinity;
let timer = 0;

export function announce(text: string): void {
  if (text === "" || waiting.includes(text)) return;
  waiting.push(text);
  clearTimeout(timer);
  timer = window.setTimeout(flushAnnouncements, Math.max(0, spoken_ms + MIN_INTERVAL_MS - performance.now()));
}

/** Discards pending announcements; to be called after a change of the language. */
export function discardAnnouncements(): void {
  clearTimeout(timer);
  waiting = [];
  byId("spoken").textContent = "";
}

function flushAnnouncements(): void {
  // timers may fire slightly early
  const rest_ms = spoken_ms + MIN_INTERVAL_MS - performance.now();
  if (rest_ms > 0) {
    timer = window.setTimeout(flushAnnouncements, rest_ms);
    return;
  }
  const box = byId("spoken");
  const text = waiting.join(" · ");
  // a repeated message has to differ for a screen reader to announce it
  box.textContent = box.textContent === text ? `${text}\u00a0` : text;
  waiting = [];
  spoken_ms = performance.now();
}

let hiding = 0;
/** Shows a message at the bottom of the page for some seconds. */
export function toast(text: string): void {
  announce(text);
  const box = byId("toast");
  box.textContent = text;
  box.hidden = false;
  clearTimeout(hiding);
  hiding = window.setTimeout(() => (box.hidden = true), 6000);
}
/** Shows an error at the bottom of the page. */
export const showError = (error: unknown): void => toast((error as Error).message);
