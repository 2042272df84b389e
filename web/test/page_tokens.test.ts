import assert from "node:assert/strict";
import test from "node:test";
import { openPage, testsOf, tokenFile } from "./page.js";

const VIEW = "view-token-01234567890";

const dialog = () => document.getElementById("token-dialog") as HTMLDialogElement;
const page = await openPage(
  ["--token-file", tokenFile(`control control-token-0123456789\nview ${VIEW}\n`)],
  () => dialog().open,
);

testsOf(page, "a page with tokens", () => {
  test("a viewer without control is asked for a token, can view and stop", async () => {
    const show = (token: string) => {
      page.byId("token").value = token;
      dialog().open = false;
      document.getElementById("token-form")!.dispatchEvent(new Event("submit", { cancelable: true }));
    };
    show("wrong-token-wrong-token");
    await page.wait("asked again", () => dialog().open && !page.byId("token-problem").hidden);
    show(VIEW);
    await page.wait("the page is loaded", () => page.isLoaded());
    assert.equal(page.viewer.role, "view");
    assert.ok(["method", "limit", "pause", "friction"].every((id) => page.byId(id).disabled));
    assert.ok(page.all<HTMLInputElement>("[data-tissue]").every((slider) => slider.disabled));
    page.click("#stop");
    await page.wait("stopped", () => page.viewer.state.emergency_stop);
  });
});
