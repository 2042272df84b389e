import assert from "node:assert/strict";
import test from "node:test";
import { JSDOM } from "jsdom";
import { LazyModule, loadModule } from "../src/words/lazy_module.js";

/** Makes a document; returns its text about missing parts, null if none is displayed. */
function pageOfItsOwn(): () => string | null {
  const { window: its } = new JSDOM('<p id="missing-parts" hidden></p>');
  Object.assign(globalThis, { document: its.document });
  console.error = () => {};
  return () => {
    const line = its.document.getElementById("missing-parts")!;
    return line.hidden ? null : line.textContent;
  };
}
const failing = { is: true };
const make = async (): Promise<string> => {
  if (failing.is) throw new TypeError("Failed to fetch dynamically imported module");
  return "made";
};

test("a part that cannot be loaded is reported on the page until it is loaded", async () => {
  const said = pageOfItsOwn();
  failing.is = true;
  const part = new LazyModule("training", make);
  assert.equal(await part.get(), null);
  assert.equal(part.value, null);
  assert.match(said()!, /^Could not be loaded: tasks\. .*including the emergency stop/);
  assert.equal(await loadModule("language", make), null);
  assert.match(said()!, /tasks, language\./);
  failing.is = false;
  assert.equal(await loadModule("language", make), "made");
  assert.equal(await part.get(), "made");
  assert.equal(part.value, "made");
  assert.equal(said(), null);
});

test("a part is constructed once", async () => {
  pageOfItsOwn();
  let made = 0;
  const part = new LazyModule("plan", async () => ++made);
  assert.deepEqual(await Promise.all([part.get(), part.get()]), [1, 1]);
  assert.equal(await part.get(), 1);
});
