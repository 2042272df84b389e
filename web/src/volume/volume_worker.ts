// Entry point of the worker that renders the volume (volume_service.ts).

import { serve, type Answered, type Port } from "./volume_service.js";

const port = self as unknown as Port;
// reports unhandled rejections to the page like thrown errors
self.addEventListener("unhandledrejection", (event) => {
  throw (event as PromiseRejectionEvent).reason;
});

/**
 * Holds a lock during the lifetime of this worker.
 * @returns name of the lock; "" if locks are unavailable, as in insecure contexts
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
else void hold().then((lockName) => serve(port, new OffscreenCanvas(64, 64), lockName));
