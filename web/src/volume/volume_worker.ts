// Entry point of the worker that renders the volume.

import { serve, type Answered, type Port } from "./volume_service.js";

const port = self as unknown as Port;
// reports later errors to the page like immediate ones
self.addEventListener("unhandledrejection", (event) => {
  throw (event as PromiseRejectionEvent).reason;
});

/**
 * Holds a lock during the lifetime of this worker.
 * @returns its name, or "" if locks are unavailable, as in insecure contexts
 */
function hold(): Promise<string> {
  const name = `palpate.volume.${performance.timeOrigin}.${Math.random()}`;
  return new Promise((done) => {
    if (!navigator.locks) return done("");
    navigator.locks
      .request(name, () => {
        done(name);
        return new Promise<never>(() => {});
      })
      .catch(() => done(""));
  });
}

if (typeof OffscreenCanvas === "undefined")
  port.postMessage({ type: "unable", why: "no OffscreenCanvas" } satisfies Answered, []);
else void hold().then((held) => serve(port, new OffscreenCanvas(64, 64), held));
