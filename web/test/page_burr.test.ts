import assert from "node:assert/strict";
import test from "node:test";
import type { Vec3 } from "../src/base/geometry.js";
import { openPage, testsOf } from "./page.js";

// each start of the motor cuts a stroke of 3 mm radius: at the centre of the femur, then 7 mm above the previous one
const page = await openPage(["--scan", "knee", "--input", "pointer", "--tool", "burr"]);
const strokes = () => page.viewer.state.strokes as { undo: number; redo: number };
const isSwitched = async (on: boolean) => {
  page.click("#motor");
  await page.wait(
    `the motor is ${on ? "on" : "off"}`,
    () => page.viewer.state.motor === on && page.viewer.state.motor_is_on === on,
  );
};
const offered = () => ["undo-stroke", "redo-stroke"].map((id) => !page.byId(id).disabled);
const areStrokes = (undo: number, redo: number) =>
  page.wait(`${undo} strokes, ${redo} undone`, () => strokes().undo === undo && strokes().redo === redo);
const [x, y, z] = page.middleOf(0);
const isThere = (at: Vec3) => page.viewer.structureAt(at) !== null;
const first: Vec3 = [x, y, z],
  second: Vec3 = [x, y, z + 7];

testsOf(page, "a knee that is milled by a ball", () => {
  test("the active method is displayed while another one is prepared", async () => {
    const said: string[] = [];
    const line = page.byId("method-awaited");
    page.set("#method", "trilinear");
    await page.wait(
      "chosen",
      () => (line.hidden || said.push(line.textContent!), page.viewer.state.method === "trilinear"),
    );
    await page.wait("nothing is awaited", () => line.hidden);
    assert.ok(said.includes("Preparing trilinear; proxy remains active until then"), said.join());
  });

  test("removed voxels disappear, and damage to protected structures is reported", async () => {
    const places: Vec3[] = [first, [x, y + 2.2, z], [x, y + 4.2, z]];
    assert.deepEqual(places.map(isThere), [true, true, true]);
    assert.equal(page.byId("motor").hidden, false);
    assert.deepEqual(offered(), [false, false]);
    await isSwitched(true);
    await page.wait("pressed", () => page.byId("motor").getAttribute("aria-pressed") === "true");
    await page.wait("cut", () => !isThere(first));
    assert.deepEqual(places.map(isThere), [false, false, true]);
    await page.wait("told", () => page.text("removed").includes("170 mm³ of femur removed"));
    assert.equal(page.text("damage"), "170 mm³ of protected femur removed");
    assert.equal(page.text("nearest"), "closest approach to tibia: 0.500 mm");
    // no stroke can be undone while the motor runs, whichever viewer started it
    assert.deepEqual(offered(), [false, false]);
    assert.equal(page.byId("undo-stroke").title, "First switch the motor off, or release its pedal");
    page.byId("undo-stroke").disabled = false;
    page.click("#undo-stroke");
    await page.wait(
      "told",
      () => page.text("toast") === "The burr's motor is on. Switch it off first." && !page.byId("toast").hidden,
    );
    assert.deepEqual(offered(), [false, false]);
    assert.ok(!isThere(first));
    await isSwitched(false);
    // a new connection reports all cuts again
    for (const type of ["pagehide", "pageshow"])
      window.dispatchEvent(Object.assign(new Event(type), { persisted: true }));
    await page.wait(
      "connected again",
      () => page.viewer.link === "connected" && page.isLoaded() && strokes().undo === 1,
    );
    // cuts are applied once their messages have arrived
    await page.wait("cut again", () => !isThere(first));
    assert.deepEqual(places.map(isThere), [false, false, true]);
  });

  test("sessions with a burr show the switch of its vibration, off, and the button of its sound", async () => {
    const box = page.byId("vibration") as unknown as HTMLInputElement;
    assert.deepEqual([box.checked, box.parentElement!.hidden], [false, false]);
    const button = page.byId("burr-sound");
    assert.deepEqual(
      [button.hidden, button.getAttribute("aria-pressed"), button.textContent],
      [false, "false", "Sound"],
    );
    box.click();
    await page.wait("vibration is on", () => page.viewer.state.vibration === true && box.checked);
    box.click();
    await page.wait("vibration is off", () => page.viewer.state.vibration === false && !box.checked);
  });

  test("strokes are undone and redone by buttons and keys", async () => {
    await isSwitched(true);
    await isSwitched(false);
    await areStrokes(2, 0);
    await page.wait("both are cut", () => !isThere(first) && !isThere(second));
    assert.deepEqual(offered(), [true, false]);
    page.click("#undo-stroke");
    await areStrokes(1, 1);
    await page.wait("one is back", () => !isThere(first) && isThere(second));
    assert.deepEqual(offered(), [true, true]);
    assert.equal(page.text("removed"), "170 mm³ of femur removed");
    // single-key shortcuts can be disabled; undo of the page's history has other keys
    page.click("#letters");
    page.key("u");
    page.click("#letters");
    page.key("U", { shiftKey: true });
    await areStrokes(2, 0);
    // the repeats of a key request nothing; the pause would be acknowledged after such a request
    page.key("u", { repeat: true });
    page.click("#pause");
    await page.wait("paused", () => page.viewer.state.paused);
    await areStrokes(2, 0);
    for (const left of [1, 0]) {
      page.key("u");
      await areStrokes(left, 2 - left);
    }
    assert.deepEqual(offered(), [false, true]);
    await page.wait("both are back", () => isThere(first) && isThere(second));
    await page.wait("told", () => page.text("removed") === "");
    page.click("#redo-stroke");
    await areStrokes(1, 1);
    await page.wait("one is cut", () => !isThere(first) && isThere(second));
    // a new stroke replaces the undone one
    await isSwitched(true);
    await isSwitched(false);
    await areStrokes(2, 0);
    await page.wait("both are cut", () => !isThere(first) && !isThere(second));
    assert.deepEqual(offered(), [true, false]);
  });

  test("the law of soft tissue changes and returns, with a wait for other surfaces", async () => {
    const law = page.byId<HTMLSelectElement>("law"),
      awaited = page.byId("law-awaited");
    assert.deepEqual(
      [...law.options].map(({ value }) => value),
      page.viewer.scene.laws,
    );
    assert.equal(law.value, "elastic");
    assert.ok(page.text("law-cells").includes("cells of 1.25 mm instead of 1.00 mm"), page.text("law-cells"));
    page.set(law, "neo-hookean");
    await page.wait(
      "another law",
      () => law.value === "neo-hookean" && page.viewer.state.law === "neo-hookean" && !page.byId("undo").disabled,
    );
    assert.ok(page.byId("law-cells").hidden, "its cells are as fine as requested");
    page.click("#undo");
    await page.wait("back", () => law.value === "elastic" && page.viewer.state.law === "elastic");
    page.set(law, "layers");
    await page.wait(
      "awaited",
      () =>
        !awaited.hidden &&
        awaited.textContent!.includes("Preparing") &&
        law.value === "layers" &&
        page.viewer.state.law === "elastic",
    );
    await page.wait("chosen", () => awaited.hidden && page.viewer.state.law === "layers");
  });
});
