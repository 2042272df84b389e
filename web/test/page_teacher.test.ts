import assert from "node:assert/strict";
import test from "node:test";
import { openLesson, signIn, TOKENS, Viewer } from "./lesson.js";
import { testsOf } from "./page.js";

const page = await openLesson();
await signIn(page, TOKENS.teacher);

/** Texts of the list of learners, row by row: the pressed button is in brackets, a disabled one is left out. */
const listed = () =>
  page.all("#lesson-learners > div").map((row) =>
    [...row.children]
      .filter((part) => !(part as HTMLButtonElement).disabled)
      .map((part) => (part.getAttribute("aria-pressed") === "true" ? `[${part.textContent}]` : part.textContent))
      .join(" "),
  );
const turn = (learner: string) => `#lesson-learners [data-learner="${learner}"]`;
const rowIs = (row: number, text: string) => page.wait(text, () => listed()[row] === text);

testsOf(page, "a teacher's page", () => {
  test("learners are chosen from a list, and the tip is passed and taken", async () => {
    await page.wait("the lesson's card", () => !page.byId("lesson-led").hidden && page.all(turn("L041")).length > 0);
    assert.equal(page.byId("lesson-learner-line").hidden, true, "nothing is typed");
    assert.deepEqual(listed(), ["[Anyone]", "L041 not connected", "L042 not connected"]);
    assert.equal(page.viewer.state.pointer_by, null, "a teacher's page leaves the pointer to the learners");
    assert.match(page.text("lesson-tip-text"), /^The tip is free/);

    const first = new Viewer(page, TOKENS.L041),
      second = new Viewer(page, TOKENS.L042);
    await rowIs(1, "L041 connected Pass the tip");
    await rowIs(2, "L042 connected Pass the tip");
    page.click(turn("L041"));
    await rowIs(1, "[L041] moves the tip");
    assert.equal(first.state!.pointer, true);
    assert.equal(second.state!.lesson.of_another, true);
    assert.deepEqual(listed(), ["Anyone", "[L041] moves the tip", "L042 connected"], "only L041 may get the tip");
    assert.equal(page.text("lesson-tip-text"), "L041 moves the tip.");

    page.click("#lesson-take");
    await rowIs(1, "[L041] connected Pass the tip");
    await page.wait("this page has it", () => page.text("lesson-tip-text") === "You move the tip.");
    assert.equal(page.byId<HTMLButtonElement & HTMLInputElement>("lesson-take").disabled, true);
    page.all<HTMLButtonElement>("#lesson-learners > div:nth-child(2) > button")[1]!.click();
    await rowIs(1, "[L041] moves the tip");

    page.click(turn("L042"));
    await rowIs(2, "[L042] moves the tip");
    page.click(turn(""));
    await rowIs(0, "[Anyone]");
    assert.equal(listed()[2], "L042 moves the tip", "the holder keeps it");
    second.close();
    await rowIs(2, "L042 not connected");
    first.close();
    await rowIs(1, "L041 not connected");
  });
  test("the end of the lesson is confirmed by a second press, and is not a lost connection", async () => {
    page.click("#lesson-end");
    page.click("#lesson-end");
    await page.wait("over", () => page.viewer.link === "over");
    page.viewer.draw();
    assert.match(page.text("lesson-note"), /The teacher has ended the lesson/);
    assert.match(page.text("toast"), /The teacher has ended the lesson/);
  });
});
