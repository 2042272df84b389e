// The volume's pictures beside the page.

import { serve, type Answered, type Port } from "./volume_service.js";

const port = self as unknown as Port;
// what fails later is told to the page as what fails at once is
self.addEventListener("unhandledrejection", (event) => {
  throw (event as PromiseRejectionEvent).reason;
});

/** Holds a lock for as long as this worker lives. @returns its name, or "" where there are none: they need a secure context */
function hold(): Promise<string> {
  const name = `palpate.volume.${performance.timeOrigin}.${Math.random()}`;
  return new Promise((done) => {
    if (!navigator.locks) return done("");
    navigator.locks.request(name, () => {
      done(name);
      return new Promise<never>(() => {});
    }).catch(() => done(""));
  });
}

if (typeof OffscreenCanvas === "undefined") port.postMessage({ type: "unable", why: "no OffscreenCanvas" } satisfies Answered, []);
else void hold().then((held) => serve(port, new OffscreenCanvas(64, 64), held));
