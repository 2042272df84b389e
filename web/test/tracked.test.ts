import assert from "node:assert/strict";
import test from "node:test";
import { trackedText } from "../src/panels/tracked.js";

test("the error of a tracked tip is displayed with its bound and warnings", () => {
  const received = { device: 0, seen: true, fre_mm: 0.31, tre_mm: 0.81, tre_95_mm: 1.42, far: false };
  assert.equal(trackedText(received), "TRE 0.8 mm, 95 %: 1.4 mm · FRE 0.3 mm");
  assert.equal(
    trackedText({ ...received, far: true }),
    "TRE 0.8 mm, 95 %: 1.4 mm · FRE 0.3 mm · far outside the registration points",
  );
  assert.equal(
    trackedText({ ...received, seen: false, tre_mm: null, tre_95_mm: null }),
    "tool not visible to the tracker · TRE unknown · FRE 0.3 mm",
  );
});
