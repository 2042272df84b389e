import assert from "node:assert/strict";
import test from "node:test";
import { add, dot, length, normalize, scale, sub, type Vec3 } from "../src/base/geometry.js";
import { Flag } from "../src/protocol/wire.js";
import { openPage, testsOf } from "./page.js";

const page = await openPage(["--scan", "sphere", "--input", "pointer"]);
const KIND = "oblique";
const RADIUS_MM = 10; // radius of the mock's sphere
const section = page.byId(`picture-${KIND}`).querySelector<HTMLElement>(".stack")!;
const middle = page.middleOf(0);
const plane = () => page.viewer.plane(KIND) as { right: Vec3; down: Vec3; normal: Vec3 };
const device = () => page.viewer.pose.devices[0] as { tip: Vec3; force: Vec3; flags: number };
/** Angle of the tip about the sphere's middle, in the plane, from its right towards below; radians. */
const angle = () => {
  const from = sub(device().tip, middle);
  return Math.atan2(dot(from, plane().down), dot(from, plane().right));
};
const touches = () => (device().flags & Flag.contact) !== 0 && length(device().force) > 0;

async function press(key: string, shiftKey: boolean, times: number): Promise<void> {
  for (let n = 0; n < times; n++) {
    const before = String(device().tip);
    page.key(key, { shiftKey }, section);
    await page.wait(`${key} moves the tip`, () => String(device().tip) !== before);
  }
}
/** Moves the tip freely, by the keys of its plane. */
async function moveTo(target: Vec3): Promise<void> {
  const { right, down, normal } = plane();
  const step_mm = 2 * length(sub(page.viewer.patientAt(KIND, 1, 0), page.viewer.patientAt(KIND, 0, 0)));
  const by = sub(target, device().tip);
  for (const [along, back, forth] of [
    [normal, "PageUp", "PageDown"],
    [down, "ArrowUp", "ArrowDown"],
    [right, "ArrowLeft", "ArrowRight"],
  ] as const) {
    const steps = Math.round(dot(by, along) / step_mm);
    for (let n = 0; n < Math.abs(steps); n++) page.key(steps < 0 ? back : forth, {}, section);
  }
  await page.wait("the tip is there", () => length(sub(device().tip, target)) < step_mm);
}
const letGo = () => section.dispatchEvent(new KeyboardEvent("keyup", { key: "Shift" }));

testsOf(page, "a sphere that is stroked by keys", () => {
  test("with Shift, arrow and page keys stroke over the surface with the chosen force", async () => {
    page.click("[data-tool=touch]");
    page.set("#press", 0.5, "input");
    await moveTo(add(middle, scale(plane().right, RADIUS_MM + 0.7)));
    await press("ArrowDown", true, 1);
    await page.wait("contact", touches);
    // to the bottom of the sphere, where a straight path would have left the surface
    await press("ArrowDown", true, 6);
    await press("ArrowLeft", true, 8);
    await page.wait("the bottom", () => angle() > 1.2);
    assert.ok(touches() && length(sub(device().tip, middle)) < RADIUS_MM);
    // and out of the plane
    const { normal } = plane();
    const before = dot(device().tip, normal);
    await press("PageDown", true, 3);
    await page.wait("another plane", () => dot(device().tip, normal) - before > 1.5);
    assert.ok(touches());
    assert.ok(dot(normalize(sub(middle, device().tip)), normal) < -0.1, "on the other slice's outline");
    assert.doesNotMatch(page.text("toast"), /lifted/i);
    letGo();
    await page.wait("no force", () => length(device().force) === 0);
  });
});
