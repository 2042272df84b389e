import type { Scene } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import {
  glossOf,
  hasBone,
  hideInitially,
  storedAppearances,
  appearancesOf,
  presetAppearances,
  restored,
  type StoredAppearances,
} from "../src/state/appearance.js";

const scene = {
  tissues: [
    { name: "cortical_bone", opacity: 1 },
    { name: "fat", opacity: 0.4 },
  ],
  structures: [
    { label: 3, name: "one", colour: [1, 2, 3], tissue: 0 },
    { label: 9, name: "two", colour: [4, 5, 6], tissue: 1 },
    { label: 12, name: "three", colour: [7, 8, 9], tissue: -1 },
  ],
} as unknown as Scene;

test("presets set visibility and opacity and keep colours", () => {
  const now = appearancesOf(scene).map((appearance) => ({
    ...appearance,
    colour: [9, 9, 9] as [number, number, number],
    visible: false,
  }));
  const seen = (name: "scene" | "solid" | "bone" | "translucent") =>
    presetAppearances(name, scene, now).map(({ visible, opacity }) => (visible ? opacity : 0));
  assert.deepEqual(seen("scene"), [1, 0.4, 1]);
  assert.deepEqual(seen("solid"), [1, 1, 1]);
  assert.deepEqual(seen("bone"), [1, 0, 0]);
  assert.deepEqual(seen("translucent"), [1, 0.3, 0.3]);
  assert.deepEqual(presetAppearances("solid", scene, now)[0]!.colour, [9, 9, 9]);
  assert.deepEqual(presetAppearances("scene", scene, now)[0]!.colour, [1, 2, 3]);
  assert.ok(hasBone(scene));
  assert.ok(!hasBone({ ...scene, tissues: [{ name: "carbon" }, { name: "tribe" }] } as unknown as Scene));
});

test("a structure is recognised as bone by its own name or its tissue's", () => {
  const seen = (tissue: string, names: string[]) => {
    const one = {
      tissues: [{ name: tissue, opacity: 1 }],
      structures: names.map((name, n) => ({ label: n + 1, name, colour: [0, 0, 0], tissue: 0 })),
    } as unknown as Scene;
    assert.equal(
      hasBone(one),
      presetAppearances("bone", one, appearancesOf(one)).some(({ visible }) => visible),
    );
    return names.filter((_, n) => presetAppearances("bone", one, appearancesOf(one))[n]!.visible);
  };
  // names of a whole-body atlas, whose structures all have the same tissue
  const bones = [
    "femur_left",
    "hip_right",
    "vertebrae_L1",
    "rib_left_12",
    "Left rib 3",
    "sternum",
    "sacrum",
    "scapula_left",
    "skull",
    "tibia",
    "patella",
    "cheekbone",
    "clavicula_right",
    "LeftFemur2",
    "carpal",
    "tarsals",
    "vertebral_body",
    "scapulae",
    "Ribs",
    "spine",
  ];
  const others = [
    "liver",
    "tibialis_anterior",
    "tibial_cartilage",
    "femur cartilage",
    "gluteus_maximus_left",
    "costal_cartilages",
    "patellar_ligament",
    "biceps_femoris_muscle",
    "rib_muscle",
    "renal_artery",
    "spinal_cord",
    "tribe",
    "renal_pelvis",
    "hip_joint_left",
    "carpalTunnel",
    "vertebral_canal",
    "radiology",
    "trapezius_left",
  ];
  assert.deepEqual(seen("tissue", [...bones, ...others]), bones);
  assert.deepEqual(seen("bone", ["piece 1", "piece 2"]), ["piece 1", "piece 2"]);
  assert.deepEqual(seen("bone marrow", ["femur"]), []);
  assert.deepEqual(seen("cartilage", ["femur", "patella"]), []);
  assert.deepEqual(seen("fat", ["infrapatellar_fat_body"]), []);
});

test("stored appearances are restored by label, and invalid ones are ignored", () => {
  const own = appearancesOf(scene);
  const changed = own.map((appearance, index) => ({ ...appearance, opacity: 0.1 * index, visible: index > 0 }));
  const kept = JSON.parse(JSON.stringify(storedAppearances(scene, changed))) as StoredAppearances;
  const other = { ...scene, structures: [...scene.structures].reverse() };
  assert.deepEqual(restored(other, [...own].reverse(), kept), [...changed].reverse());
  const broken = {
    3: null,
    9: { colour: [1, 2], opacity: 1 },
    12: { colour: [1, 2, 300], opacity: 1, visible: true },
  } as unknown as StoredAppearances;
  assert.deepEqual(restored(scene, own, broken), own);
});

test("a structure that is to be found by touch is hidden initially, and shown on demand", () => {
  const block = {
    ...scene,
    structures: [...scene.structures, { label: 13, name: "nodule", colour: [1, 1, 1], tissue: 1 }],
  };
  hideInitially("nodule");
  const own = appearancesOf(block as unknown as Scene);
  assert.deepEqual(
    own.map(({ visible }) => visible),
    [true, true, true, false],
  );
  assert.ok(presetAppearances("translucent", block as unknown as Scene, own).every(({ visible }) => visible));
});

test("what slides well shines: cartilage more than ligament, bone little, skin and what has no tissue not", () => {
  const [cartilage, ligament, bone] = [0.025, 0.1, 0.2].map(glossOf) as [number, number, number];
  assert.ok(255 >= cartilage && cartilage > ligament && ligament > bone && bone > 0);
  for (const dry of [0.3, 2, undefined]) assert.equal(glossOf(dry), 0);
});
