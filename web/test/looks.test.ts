import assert from "node:assert/strict";
import test from "node:test";
import { hasBone, keptLooks, looksOf, presetLooks, restored, type KeptLooks } from "../src/looks.js";
import type { Scene } from "../src/scene.js";

const scene = {
  tissues: [{ name: "cortical_bone", opacity: 1 }, { name: "fat", opacity: 0.4 }],
  structures: [{ label: 3, colour: [1, 2, 3], tissue: 0 }, { label: 9, colour: [4, 5, 6], tissue: 1 }, { label: 12, colour: [7, 8, 9], tissue: -1 }],
} as unknown as Scene;

test("presets show what they say, and leave colours as they are", () => {
  const now = looksOf(scene).map((look) => ({ ...look, colour: [9, 9, 9] as [number, number, number], visible: false }));
  const seen = (name: "scene" | "solid" | "bone" | "translucent") => presetLooks(name, scene, now).map(({ visible, opacity }) => (visible ? opacity : 0));
  assert.deepEqual(seen("scene"), [1, 0.4, 1]);
  assert.deepEqual(seen("solid"), [1, 1, 1]);
  assert.deepEqual(seen("bone"), [1, 0, 0]);
  assert.deepEqual(seen("translucent"), [1, 0.3, 0.3]);
  assert.deepEqual(presetLooks("solid", scene, now)[0]!.colour, [9, 9, 9]);
  assert.deepEqual(presetLooks("scene", scene, now)[0]!.colour, [1, 2, 3]);
  assert.ok(hasBone(scene));
  assert.ok(!hasBone({ ...scene, tissues: [{ name: "carbon" }, { name: "tribe" }] } as unknown as Scene));
});

test("kept looks are given back by label, and what is none is left out", () => {
  const own = looksOf(scene);
  const changed = own.map((look, place) => ({ ...look, opacity: 0.1 * place, visible: place > 0 }));
  const kept = JSON.parse(JSON.stringify(keptLooks(scene, changed))) as KeptLooks;
  const other = { ...scene, structures: [...scene.structures].reverse() };
  assert.deepEqual(restored(other, [...own].reverse(), kept), [...changed].reverse());
  const broken = { 3: null, 9: { colour: [1, 2], opacity: 1 }, 12: { colour: [1, 2, 300], opacity: 1, visible: true } } as unknown as KeptLooks;
  assert.deepEqual(restored(scene, own, broken), own);
});
