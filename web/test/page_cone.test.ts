import assert from "node:assert/strict";
import test from "node:test";
import { openPage, testsOf } from "./page.js";

const page = await openPage(["--scan", "knee", "--input", "device", "--tool", "burr", "--burr", "cone"]);

testsOf(page, "a knee that is milled by a cone", () => {
  test("a cone removes its row of balls, and undoing a stroke is confirmed at the device", async () => {
    assert.ok(page.text("device").includes("conical burr"), page.text("device"));
    const isSwitched = async (on: boolean) => {
      page.click("#motor");
      await page.wait(`the motor is ${on ? "on" : "off"}`, () => page.viewer.state.motor_is_on === on);
    };
    const [x, y, z] = page.middleOf(0);
    // positions on and next to the head's axis: its radius is 1 mm at the tip, 2.5 mm at 6 mm above it
    const found = () =>
      [
        [0, 0],
        [1.8, 0],
        [1.8, 6],
        [3.4, 6],
      ].map(([aside, up]) => page.viewer.structureAt([x + 1, y + aside!, z + up!]) !== null);
    const before = found();
    assert.deepEqual(before.slice(0, 3), [true, true, true]);
    await page.wait("armed", () => page.viewer.state.armed);
    await isSwitched(true);
    await page.wait("cut", () => !found()[0]);
    assert.deepEqual(found(), [false, true, false, before[3]]);
    await isSwitched(false);

    page.byId("toast").hidden = true;
    page.click("#undo-stroke");
    await page.wait(
      "asked",
      () => page.text("toast").startsWith("Waiting for consent at the device") && !page.byId("toast").hidden,
    );
    assert.deepEqual(
      ["undo-stroke", "redo-stroke"].map((id) => !page.byId(id).disabled),
      [true, false],
      "nobody has agreed yet",
    );
    await page.wait("undone", () => page.viewer.state.strokes.redo === 1 && found()[0]);
    assert.deepEqual(found(), before);
  });
});
