import assert from "node:assert/strict";
import test from "node:test";
import { openPage, testsOf } from "./page.js";

const page = await openPage([]);
const { server } = page;

/** Expects a permanent error to be reported with given texts, and no requests until the user retries. */
async function reportedAndUnchanged(...received: string[]): Promise<void> {
  await page.wait("the page gives up", () => page.viewer.link === "ended" && !page.byId("remedy").hidden);
  for (const words of received) assert.ok(page.text("cover").includes(words), `${words} in: ${page.text("cover")}`);
  const fetched = globalThis.fetch,
    Socket = globalThis.WebSocket;
  const attempts: string[] = [];
  Object.assign(globalThis, {
    fetch: (...all: Parameters<typeof fetch>) => (attempts.push(String(all[0])), fetched(...all)),
    WebSocket: class extends Socket {
      constructor(...all: ConstructorParameters<typeof WebSocket>) {
        super(...all);
        attempts.push(String(all[0]));
      }
    },
  });
  // longer than the maximum interval between attempts to connect
  await new Promise((later) => setTimeout(later, 6500));
  Object.assign(globalThis, { fetch: fetched, WebSocket: Socket });
  assert.deepEqual(attempts, []);
}
async function restart(options: string[]): Promise<void> {
  await server.stop();
  await server.start(["--scan", "ramp", ...options]);
}
async function mended(): Promise<void> {
  await restart([]);
  page.click("#again");
  await page.wait("the page is loaded", () => page.isLoaded() && page.viewer.link === "connected");
}

testsOf(page, "a page with errors", () => {
  test("old data is grey, and a restarted server is found", async () => {
    server.signal("SIGSTOP");
    await page.wait(
      "stale",
      () =>
        !page.viewer.isFresh &&
        page.viewer.age_ms > 250 &&
        document.body.classList.contains("stale") &&
        page.text("link-text").includes("old"),
    );
    server.signal("SIGCONT");
    await page.wait("fresh", () => page.viewer.isFresh && !document.body.classList.contains("stale"));
    await server.stop();
    await page.wait("lost", () => page.viewer.link !== "connected");
    await restart([]);
    await page.wait("found", () => page.isLoaded() && page.viewer.link === "connected" && page.viewer.age_ms < 250);
  });

  test("a page that is left releases the connection, and reconnects when it is shown again", async () => {
    const leave = (type: string) => window.dispatchEvent(Object.assign(new Event(type), { persisted: true }));
    leave("pagehide");
    await page.wait("ended", () => page.viewer.link === "ended");
    leave("pageshow");
    await page.wait("connected", () => page.viewer.link === "connected" && page.viewer.isFresh);
  });

  test("another protocol version is reported", async () => {
    await restart(["--protocol", "4"]);
    await reportedAndUnchanged("version 4", "version 3", "palpate 0.0.0-mock", "Reload the page");
    page.click("#again"); // a retry, which fails
    await page.wait("told again", () => !page.byId("remedy").hidden);
    await mended();
  });

  test("a permanent refusal is reported", async () => {
    await restart(["--refuse", "421"]);
    await reportedAndUnchanged("421", "--host-name");
    await mended();
  });
});
