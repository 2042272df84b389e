import assert from "node:assert/strict";
import test from "node:test";
import { isBookmark, type Bookmark } from "../src/panels/bookmarks.js";

const whole: Bookmark = {
  name: "neck",
  view: {
    layout: "five",
    window: { level: 40, width: 400 },
    camera: { right: [1, 0, 0], up: [0, 0, 1], focus: [1, 2, 3], across_mm: 0 },
    cross: null,
    normal: [1, 0, 0],
    along: "tool",
    anatomical: "axial",
    sections: [{ kind: "oblique", across_mm: 90, pan: [0, 1], offset_mm: 0 }],
    rotation: [1, 0, 0, 0],
  },
};

test("stored bookmarks are listed if complete, and others are ignored", () => {
  assert.ok(isBookmark(JSON.parse(JSON.stringify(whole))));
  assert.ok(isBookmark({ ...whole, view: { ...whole.view, cross: [1, 2, 3], rotation: null } }));
  const wrong: Record<string, unknown>[] = [
    { layout: "seven" },
    { window: null },
    { window: { level: 1, width: 0 } },
    { camera: { ...whole.view.camera, up: [0, 1] } },
    { cross: [1, 2] },
    { normal: ["a", 0, 0] },
    { along: "me" },
    { anatomical: "" },
    { sections: null },
    { sections: [{ ...whole.view.sections[0], across_mm: -1 }] },
    { rotation: [1] },
  ];
  for (const view of wrong)
    assert.ok(!isBookmark({ ...whole, view: { ...whole.view, ...view } }), JSON.stringify(view));
  for (const none of [null, 3, {}, { name: "x" }, { name: 3, view: whole.view }]) assert.ok(!isBookmark(none));
});
