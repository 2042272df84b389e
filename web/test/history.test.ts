import type { Refusal, Request, State } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import type { Connection } from "../src/protocol/connection.js";
import { History } from "../src/state/history.js";
import { measuresTable, type Measure } from "../src/drawing/measure.js";
import { Requests } from "../src/state/requests.js";

/** Simulated loop that grants every request except those in `refuses`. */
function loop() {
  const received: string[] = [];
  Object.assign(globalThis, {
    document: {
      getElementById: () => ({
        set textContent(text: string) {
          received.push(text);
        },
      }),
    },
    window: globalThis,
  });
  const state = {
    method: "proxy",
    method_awaited: null,
    friction: true,
    paused: false,
    max_force_N: 1.4,
    tissues: [{ stiffness_N_per_mm: 1 }, { stiffness_N_per_mm: 2 }],
  } as unknown as State;
  const asked: Request[] = [];
  const made = { state, asked, received, refuses: "", history: new History() };
  const connection = {
    request: (request: Request): Promise<Refusal | null> => {
      asked.push(request);
      const { type, tissue, ...values } = request;
      if (made.refuses && Object.keys(values).includes(made.refuses)) return Promise.resolve({ what: "no" });
      if (type === "tissue") Object.assign(state.tissues[tissue as number]!, values);
      if (type === "set") Object.assign(state, values);
      return Promise.resolve(null);
    },
  } as unknown as Connection;
  return Object.assign(made, {
    requests: new Requests(
      connection,
      () => false,
      () => state,
      made.history,
    ),
  });
}

test("a slider movement is one undo step, and undo requests the previous value", async () => {
  const { requests, history, state, asked } = loop();
  for (const value of [1.5, 1.6, 1.7])
    await requests.latest("stiffness 0", { type: "tissue", tissue: 0, stiffness_N_per_mm: value });
  await requests.once({ type: "set", friction: false });
  assert.equal(asked.length, 4);
  await history.undo();
  assert.equal(state.friction, true);
  await history.undo();
  assert.deepEqual(asked.at(-1), { type: "tissue", tissue: 0, stiffness_N_per_mm: 1 });
  assert.equal(history.canUndo.value, false);
  await history.redo();
  assert.equal(state.tissues[0]!.stiffness_N_per_mm, 1.7);
  await history.redo();
  assert.equal(state.friction, false);
  assert.equal(history.canRedo.value, false);
  // a new step discards the redo history
  await history.undo();
  await requests.once({ type: "set", max_force_N: 1 });
  assert.equal(history.canRedo.value, false);
});

test("successive movements of one slider are separate undo steps", async () => {
  const { requests, history, state } = loop();
  await requests.latest("limit", { type: "set", max_force_N: 1.2 });
  history.gesture += 1;
  await requests.latest("limit", { type: "set", max_force_N: 1 });
  await history.undo();
  assert.equal(state.max_force_N, 1.2);
});

test("undo requests the previous rotation, and a drag is one undo step", async () => {
  const { requests, history, state, asked } = loop();
  state.rotation_wxyz = [1, 0, 0, 0];
  const turned = (angle: number): [number, number, number, number] => [Math.cos(angle), 0, Math.sin(angle), 0];
  for (const angle of [0.1, 0.2, 0.3])
    await requests.latest("rotation", { type: "set", rotation_wxyz: turned(angle) }, 7);
  await requests.latest("rotation", { type: "set", rotation_wxyz: turned(0.4) }, 8);
  // a reported quaternion is rounded and may have the opposite sign
  state.rotation_wxyz = turned(0.4).map((x) => -Math.fround(x)) as typeof state.rotation_wxyz;
  await history.undo();
  assert.deepEqual(state.rotation_wxyz, turned(0.3));
  await history.undo();
  assert.deepEqual(asked.at(-1), { type: "set", rotation_wxyz: [1, 0, 0, 0] });
  assert.equal(history.canUndo.value, false);
  await history.redo();
  // a change by another viewer
  state.rotation_wxyz = turned(0.31);
  await history.undo();
  assert.deepEqual(state.rotation_wxyz, turned(0.31));
});

test("a stop, a pause and a rearm are not undo steps", async () => {
  const { requests, history } = loop();
  for (const request of [
    { type: "stop" },
    { type: "rearm", stop: 1 },
    { type: "set", paused: true },
    { type: "set", friction: false, paused: false },
    { type: "pointer", take: true },
  ] as Request[])
    await requests.once(request);
  assert.equal(history.canUndo.value, false);
});

test("a refused undo is reported and remains available; values changed by others are kept", async () => {
  const made = loop();
  const { requests, history, state, received } = made;
  made.refuses = "max_force_N";
  await requests.once({ type: "set", max_force_N: 1 });
  assert.equal(history.canUndo.value, false);
  made.refuses = "";
  await requests.once({ type: "set", max_force_N: 1 });
  made.refuses = "max_force_N";
  received.length = 0;
  await history.undo();
  assert.deepEqual(received, ["No."]);
  assert.equal(state.max_force_N, 1);
  assert.equal(history.canUndo.value, true);
  assert.equal(history.canRedo.value, false);
  made.refuses = "";
  state.max_force_N = 0.7;
  await history.undo();
  assert.equal(state.max_force_N, 0.7);
  assert.match(received.at(-1)!, /another viewer/);
  state.max_force_N = 1;
  await history.undo();
  assert.equal(state.max_force_N, 1.4);
});

test("the table of measurements has points in LPS and unchanged names", () => {
  const made = { plane: "axial", slice: 12, normal: [0, 0, 1] } as Pick<Measure, "plane" | "slice" | "normal">;
  const table = measuresTable([
    {
      ...made,
      kind: "ruler",
      name: 'neck, "left"',
      points: [
        [1, 2, 3],
        [1, 5, 7],
      ],
    },
    {
      ...made,
      kind: "angle",
      name: "tilt",
      points: [
        [1, 0, 0],
        [0, 0, 0],
        [0, 2, 0],
      ],
    },
  ]);
  assert.deepEqual(table.split("\r\n"), [
    "name,kind,plane,slice,length_mm,angle_deg," +
      "x1_lps_mm,y1_lps_mm,z1_lps_mm,x2_lps_mm,y2_lps_mm,z2_lps_mm,x3_lps_mm,y3_lps_mm,z3_lps_mm",
    '"neck, ""left""",ruler,axial,12,5.000,,1.000,2.000,3.000,1.000,5.000,7.000,,,',
    '"tilt",angle,axial,12,,90.00,1.000,0.000,0.000,0.000,0.000,0.000,0.000,2.000,0.000',
    "",
  ]);
});

test("changes of the view are undone one by one, and automatic changes are kept", async () => {
  const history = new History();
  const seen = { zoom: 1, pan: [0, 0], window: 5 };
  history.register(
    "section",
    () => ({ zoom: seen.zoom, pan: seen.pan }),
    (to) => Object.assign(seen, to),
  );
  history.register(
    "window",
    () => seen.window,
    (to) => (seen.window = to),
  );
  history.change("keys", () => (seen.zoom = 2));
  // changes of one kind in one gesture are one step, a change of another kind is a further one
  for (const pan of [
    [1, 0],
    [2, 0],
    [3, 1],
  ])
    history.change("drag", () => (seen.pan = pan), history.gesture);
  history.change("drag", () => (seen.window = 7), history.gesture);
  // an action without a change is no step
  history.change("keys", () => (seen.zoom = 2));
  await history.undo();
  assert.deepEqual(seen, { zoom: 2, pan: [3, 1], window: 5 });
  seen.window = 9;
  await history.undo();
  assert.deepEqual(seen, { zoom: 2, pan: [0, 0], window: 9 });
  await history.undo();
  assert.deepEqual([seen.zoom, history.canUndo.value], [1, false]);
  await history.redo();
  await history.redo();
  assert.deepEqual(seen, { zoom: 2, pan: [3, 1], window: 9 });
});
