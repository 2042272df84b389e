import assert from "node:assert/strict";
import test, { beforeEach } from "node:test";
import { openPage, testsOf } from "./page.js";

// physical device: requests are confirmed there, after a delay
const page = await openPage(["--input", "device"]);
const types = (code: string) => {
  const field = page.byId("arm-code");
  for (const digit of code) {
    page.key(digit, {}, field);
    // the key of the emergency stop enters no character
    if (digit !== " ") page.set(field, field.value + digit, "input");
  }
};

testsOf(page, "a physical device", () => {
  beforeEach(async () => {
    if (page.viewer.state.emergency_stop) {
      page.set("#arm-code", "123456", "input");
      page.click("#rearm");
    }
    await page.wait("armed", () => page.viewer.state.armed && page.byId("arm-line").hidden);
    page.key(" ");
    await page.wait(
      "stopped",
      () => page.viewer.state.emergency_stop && !page.viewer.state.armed && !page.byId("arm-line").hidden,
    );
  });

  test("it is stopped from the page and armed at the device", async () => {
    await page.wait(
      "said",
      () => (
        page.draw(),
        page.text("flags").includes("stopped by this page · free the tip, then press r in palpate's terminal")
      ),
    );
    assert.ok(page.byId("rearm").disabled);
    assert.equal(page.text("stop"), "Stopped");
  });

  test("it is armed from the page with the code shown at the device", async () => {
    assert.equal(page.byId("arm-code").labels![0]!.textContent!.trim(), "Six-digit code");
    types("12345");
    assert.ok(page.byId("rearm").disabled, "five digits are no code");
    // a wrong code is reported and the field cleared
    types("7");
    page.click("#rearm");
    await page.wait("told", () => page.text("toast").includes("not the one that is shown"));
    assert.equal(page.byId("arm-code").value, "");
    assert.ok(page.viewer.state.emergency_stop && page.byId("rearm").disabled);
    // the space bar is the emergency stop in the code's field, too
    const { stop } = page.viewer.state;
    types("12 3");
    await page.wait("stopped once more", () => page.viewer.state.stop > stop);
    types("456");
    page.key("Enter", {}, page.byId("arm-code"));
    await page.wait(
      "armed",
      () => page.viewer.state.armed && !page.viewer.state.emergency_stop && page.byId("arm-line").hidden,
    );
  });
});
