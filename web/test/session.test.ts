import type { Scene } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import type { Vec3 } from "../src/base/geometry.js";
import { showsTheSame, Volumes } from "../src/protocol/scene.js";
import { words } from "../src/words/words.js";
import { Session } from "../src/state/session.js";
import { Flag, type DevicePose, type Pose } from "../src/protocol/wire.js";

/** Session with one structure, "femoral_cartilage" with label 7, in voxels 2 to 4 of a row. */
function session(): Session {
  const made = new Session();
  const voxels = new Uint8Array([0, 0, 1, 1, 1, 0]);
  made.volumes.value = new Volumes(
    "h",
    1,
    [6, 1, 1],
    [
      [1, 0, 0, 0],
      [0, 1, 0, 0],
      [0, 0, 1, 0],
      [0, 0, 0, 1],
    ],
    null,
    voxels,
    1,
    0,
  );
  made.scene.value = {
    structures: [{ label: 7, name: "femoral_cartilage", colour: [0, 0, 0], tissue: 0 }],
    tissues: [{ touchable: true }],
    no_go: [],
  } as unknown as Scene;
  return made;
}
const device = (x: number, label: number, flags: number, force: Vec3): DevicePose =>
  ({ tip: [x, 0, 0], label, flags, force }) as DevicePose;

test("a scene in which no tissue is felt says so in place of a contact", () => {
  const made = session();
  made.scene.value = { ...made.scene.value!, tissues: [{ touchable: false }] } as unknown as Scene;
  for (const x of [0, 3])
    assert.deepEqual(made.contactOf(device(x, 0, 0, [0, 0, 0])), { label: 0, words: words.nothingTouchable });
});

test("a touched structure is felt while there is a force or nothing withholds it", () => {
  const contact = (x: number, label: number, flags: number, force: Vec3 = [0, 0, 0]) =>
    session().contactOf(device(x, label, flags, force));
  const felt = { label: 7, words: "femoral cartilage" };
  const notFelt = { label: 0, words: "femoral cartilage, not felt" };
  assert.deepEqual(contact(3, 7, Flag.contact, [0, 0, 0.4]), felt);
  assert.deepEqual(contact(3, 7, Flag.contact), felt, "touched by less than can be sent");
  for (const withheld of [Flag.emergencyStop, Flag.paused, Flag.stale, Flag.deviceFault, Flag.halted, Flag.clutched]) {
    assert.deepEqual(contact(3, 7, Flag.contact | withheld, [0, 0, 0.1]), felt, "while it fades");
    assert.deepEqual(contact(3, 7, Flag.contact | withheld), notFelt);
  }
  assert.deepEqual(contact(3, 0, Flag.inside), notFelt, "from the beginning");
  assert.deepEqual(contact(0, 0, 0), { label: 0, words: "no contact" });
  assert.deepEqual(contact(0, 0, Flag.stale), { label: 0, words: "no contact" });
  assert.deepEqual(contact(-9, 0, Flag.outside), { label: 0, words: "outside the volume" });
});

test("a nested structure is named with those that enclose it, except in a quiz", () => {
  const made = session();
  const structure = (label: number, name: string, within: number[]) => ({
    label,
    name,
    within,
    colour: [0, 0, 0],
    tissue: 0,
  });
  made.scene.value = {
    ...made.scene.value!,
    structures: [structure(7, "gross_tumour", [8, 9]), structure(8, "target", [9]), structure(9, "liver", [])],
  } as unknown as Scene;
  const touched = () => made.contactOf(device(3, 7, Flag.contact, [0, 0, 0.4])).words;
  assert.equal(touched(), "gross tumour (within target, liver)");
  assert.equal(made.contactOf(device(3, 9, Flag.contact, [0, 0, 0.4])).words, "liver");
  made.quiz.value = [9];
  assert.equal(touched(), "a structure");
});

test("each device has its own tool, and the first one is drawn on top", () => {
  const made = session();
  const [ball, burr] = [
    { name: "ball", cuts: false },
    { name: "drill", cuts: true },
  ];
  made.scene.value = { ...made.scene.value!, tools: [ball, burr] } as Scene;
  const devices = [0, 1].map((number) => ({ ...device(number, 0, 0, [0, 0, 0]), number }));
  assert.deepEqual(made.drawn, [], "without a pose");
  made.setPose({ time: 1, devices } as unknown as Pose);
  assert.deepEqual(
    made.drawn.map(({ number }) => number),
    [1, 0],
  );
  assert.deepEqual(
    devices.map((one) => made.toolOf(one)),
    [ball, burr],
  );
  assert.deepEqual(made.pose.value!.devices, devices, "which stay in their order");
});

test("a tool in contact is drawn at the surface, deformed if it yields", () => {
  const made = session();
  const pressed = {
    ...device(3, 7, Flag.contact, [0, 0, 1]),
    proxy: [4, 0, 0],
    contacts: [{ position: [5, 0, 0] }],
  } as unknown as DevicePose;
  assert.deepEqual(made.toolAt(pressed), [4, 0, 0]);
  made.displacementAt.value = ([x]) => [-0.1 * x, 0, 0];
  assert.deepEqual(made.toolAt(pressed), [3.5, 0, 0], "as far as the tissue went where it is touched");
  assert.deepEqual(made.toolAt({ ...pressed, contacts: [] }), [3.6, 0, 0]);
  for (const flags of [0, Flag.contact | Flag.inside])
    assert.deepEqual(made.toolAt({ ...pressed, flags }), [3, 0, 0], "where the hand is");
});

test("a paused recording adds no trail", () => {
  const made = session();
  const at = (time: number) => made.setPose({ time, devices: [device(3, 0, 0, [0, 0, 0])] } as unknown as Pose);
  for (let n = 0; n < 1000; n++) at(1.5);
  assert.equal(made.trail.length, 1);
  at(1.6);
  assert.equal(made.trail.length, 2);
});

test("equal voxels with another placement or other structures are another scene", () => {
  const scene = (affine: number, ...labels: number[]) =>
    ({
      volume: { hash: "h", patient_from_voxel: [affine] },
      world_from_patient: [1],
      structures: labels.map((label) => ({ label, name: "n" })),
    }) as unknown as Scene;
  assert.ok(showsTheSame(scene(1, 7, 8), scene(1, 7, 8)));
  assert.ok(!showsTheSame(scene(1, 7, 8), null));
  for (const other of [scene(2, 7, 8), scene(1, 8, 7), scene(1, 7)]) assert.ok(!showsTheSame(other, scene(1, 7, 8)));
});
