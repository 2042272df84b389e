import assert from "node:assert/strict";
import test from "node:test";
import { signal } from "@preact/signals-core";
import { Watch } from "../src/base/watch.js";

test("an action is due after a change of a signal that its latest run read", () => {
  const [which, a, b] = [signal("a"), signal(1), signal(1)];
  const watch = new Watch();
  const read: number[] = [];
  const run = () => watch.run(() => read.push((which.value === "a" ? a : b).value));
  assert.equal(watch.isDue, true, "before the first run");
  run();
  assert.equal(watch.isDue, false);
  b.value = 2;
  a.value = 1;
  assert.equal(watch.isDue, false, "the signal was not read, or has its value");
  a.value = 3;
  a.value = 4;
  assert.deepEqual([watch.isDue, read], [true, [1]], "the action runs when it is asked to");
  which.value = "b";
  run();
  assert.deepEqual([watch.isDue, read], [false, [1, 2]]);
  a.value = 5;
  assert.equal(watch.isDue, false, "an earlier run has read it");
  b.value = 6;
  assert.equal(watch.isDue, true);
});

test("an action is due again if it changes a signal that it read, and stays due if it throws", () => {
  const count = signal(0);
  const watch = new Watch();
  watch.run(() => (count.value += 1));
  assert.deepEqual([watch.isDue, count.value], [true, 1]);
  watch.run(() => void count.value);
  assert.equal(watch.isDue, false);
  assert.throws(() =>
    watch.run(() => {
      throw new Error("no");
    }),
  );
  assert.equal(watch.isDue, true);
});
