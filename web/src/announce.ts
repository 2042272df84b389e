// What is spoken to somebody who does not look at the page: at most once a second, all that came meanwhile together.

import { byId } from "./dom.js";

const LEAST_MS = 1000;
let waiting: string[] = [];
let spoken_ms = -Infinity;
let timer = 0;

export function announce(text: string): void {
  if (text === "" || waiting.includes(text)) return;
  waiting.push(text);
  clearTimeout(timer);
  timer = window.setTimeout(speak, Math.max(0, spoken_ms + LEAST_MS - performance.now()));
}

/** What was said, or is yet to be, is in another language. */
export function hush(): void {
  clearTimeout(timer);
  waiting = [];
  byId("spoken").textContent = "";
}

function speak(): void {
  // a timer may come a little early
  const rest_ms = spoken_ms + LEAST_MS - performance.now();
  if (rest_ms > 0) {
    timer = window.setTimeout(speak, rest_ms);
    return;
  }
  const box = byId("spoken");
  const text = waiting.join(" · ");
  // the same once more is something new, too
  box.textContent = box.textContent === text ? `${text}\u00a0` : text;
  waiting = [];
  spoken_ms = performance.now();
}
