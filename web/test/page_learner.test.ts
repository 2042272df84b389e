import assert from "node:assert/strict";
import test from "node:test";
import { openLesson, signIn, TOKENS, Viewer } from "./lesson.js";
import { testsOf } from "./page.js";

const page = await openLesson();
const teacher = new Viewer(page, TOKENS.teacher);
await page.wait("the teacher is connected", () => teacher.state);
teacher.ask({ type: "pointer", take: true });
await page.wait("the teacher's page has the pointer", () => teacher.state!.pointer);
await signIn(page, TOKENS.L041);

const isBeginDisabled = () => page.byId("task-begin").disabled;

testsOf(page, "a learner's page", () => {
  test("the learner who is named begins and touches at once", async () => {
    page.set("#task", "probing");
    await page.wait("another's pointer", () => page.viewer.state.pointer_by === "viewer" && isBeginDisabled());
    assert.equal(page.byId("lesson-led").hidden, true);
    teacher.ask({ type: "lesson", learner: "L041" });
    await page.wait("the pointer", () => page.viewer.state.pointer);
    await page.wait("Begin is enabled", () => !isBeginDisabled());
    assert.equal(page.all("[data-tool=touch]")[0]!.getAttribute("aria-checked"), "true");

    teacher.ask({ type: "lesson", learner: "L042" });
    await page.wait("another's turn", () => page.viewer.state.lesson.of_another);
    assert.ok(isBeginDisabled());
    assert.match(page.text("lesson-note"), /Another learner's turn/);
  });
  test("a press takes a pointer that no viewer has", async () => {
    teacher.ask({ type: "lesson", learner: "" });
    await page.wait("anyone's turn", () => page.viewer.state.lesson.of_another === false);
    assert.equal(page.viewer.state.pointer_by, null);
    const section = page.all(".stack").at(-1)!;
    const before = page.viewer.pose.devices[0].tip;
    page.key("ArrowDown", {}, section);
    await page.wait("the pointer", () => page.viewer.state.pointer);
    await page.wait("the tip moves", () => String(page.viewer.pose.devices[0].tip) !== String(before));
    section.dispatchEvent(new KeyboardEvent("keyup", { key: "ArrowDown" }));
  });
  test("the end of the lesson is said, and the page does not connect again", async () => {
    teacher.ask({ type: "lesson", end: true });
    await page.wait("over", () => page.viewer.link === "over");
    assert.match(page.text("toast"), /The teacher has ended the lesson/);
    await page.wait("the state of the connection", () => page.byId("link").dataset.link === "over");
    await page.wait("its text", () => /The teacher has ended the lesson/.test(page.text("link-text")));
    assert.doesNotMatch(page.text("spoken"), /lost/);
    await page.wait("why no run can begin", () => /The teacher has ended the lesson/.test(page.text("task-note")));
  });
});
