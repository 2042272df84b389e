import type { DeviceTool, Plan, Trajectory } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import { aboutAxis, add, dot, length, rotate, scale, sub, type Vec3 } from "../src/base/geometry.js";
import { History } from "../src/state/history.js";
import { breachesOf, deviationFrom, planText, shaftOf, toTrajectory } from "../src/state/plan.js";
import { PlanStore } from "../src/state/plan_store.js";

const trajectory = (entry_mm: Vec3, target_mm: Vec3, name = "hole"): Trajectory => ({
  name,
  entry_mm,
  target_mm,
  entry_within_mm: null,
  target_within_mm: 1.5,
  angle_within_deg: null,
  depth_within_mm: null,
});
const plan = (of: Partial<Plan> = {}): Plan => ({
  version: 3,
  saved: true,
  can_change: true,
  trajectories: [trajectory([0, 0, 0], [0, 0, 20])],
  keep_away: [],
  ...of,
});
const near = (a: number, b: number, slack = 1e-9) => assert.ok(Math.abs(a - b) < slack, `${a} ${b}`);

test("distance, depth and shaft angle of a tip at trajectories of any direction", () => {
  let seed = 5;
  const random = () => (seed = (seed * 16807) % 2147483647) / 2147483647 - 0.5;
  for (let n = 0; n < 200; n++) {
    const q = aboutAxis([random(), random(), random() + 2], 6 * random());
    const at: Vec3 = [50 * random(), 50 * random(), 50 * random()];
    const placed = (p: Vec3): Vec3 => add(at, rotate(q, p));
    const [x, y, z, tilt] = [20 * random(), 20 * random(), 60 * random(), Math.PI * (random() + 0.5)];
    const one = trajectory(placed([0, 0, 0]), placed([0, 0, 20]));
    // shaft from tip to handle, tilted against the trajectory's axis
    const deviation = deviationFrom(one, placed([x, y, z]), scale(rotate(q, [Math.sin(tilt), 0, Math.cos(tilt)]), -1));
    near(deviation.lateral_mm, Math.hypot(x, y), 1e-6);
    near(deviation.left_mm, 20 - z, 1e-6);
    near(deviation.angle_deg!, (180 * tilt) / Math.PI, 1e-6);
    near(toTrajectory(one, placed([x, y, z])), Math.hypot(x, y, z < 0 ? z : z > 20 ? z - 20 : 0), 1e-6);
  }
  assert.equal(deviationFrom(trajectory([0, 0, 0], [0, 0, 1]), [0, 0, 0], null).angle_deg, null);
});

test("the shaft of a tool is its longest part, from tip to handle", () => {
  const tool = (...capsules: [Vec3, Vec3][]) =>
    ({
      capsules: capsules.map(([from_mm, to_mm]) => ({ from_mm, to_mm, radius_mm: 1, end_radius_mm: 1 })),
    }) as unknown as DeviceTool;
  assert.equal(shaftOf(tool()), null);
  assert.deepEqual(
    shaftOf(
      tool(
        [
          [0, 0, 0],
          [0, 0, 5],
        ],
        [
          [0, 40, 0],
          [0, 0, 0],
        ],
      ),
    ),
    [0, 1, 0],
  );
});

test("violated distances of the plan are listed, the worst first", () => {
  const of = plan({
    keep_away: [
      { label: 7, mm: 3 },
      { label: 8, mm: 2 },
      { label: 9, mm: 5 },
    ],
  });
  assert.deepEqual(
    breachesOf(of, [
      { label: 8, mm: 1.5 },
      { label: 7, mm: 1 },
      { label: 9, mm: 5 },
      { label: 1, mm: 0 },
    ]),
    [
      { label: 7, mm: 1, requested_mm: 3 },
      { label: 8, mm: 1.5, requested_mm: 2 },
    ],
  );
});

test("a plan is written in the format of its file", () => {
  assert.equal(
    planText(
      plan({ trajectories: [trajectory([0.1, -0, 2], [1e-7, 3, 4.25])], keep_away: [{ label: 7, mm: 3 }] }),
      'a "hole"',
    ),
    'title = "a \\"hole\\""\n\n' +
      '[[trajectory]]\nname = "hole"\nentry = [0.1, 0, 2]\ntarget = [1e-7, 3, 4.25]\ntarget_within = 1.5\n\n' +
      "[[keep_away]]\nstructures = [7]\ndistance = 3\n",
  );
});

/** Simulated server with a plan, which stores all versions and grants every request. */
function shared() {
  const history = new History();
  const asked: Record<string, unknown>[] = [];
  const may = { ask: true, refuses: false };
  let now = plan();
  const versions = new Map([[now.version, now]]);
  const store = new PlanStore(
    history,
    async (request) => {
      asked.push(request);
      if (may.refuses || request.version !== now.version) return false;
      const list = now.trajectories.slice();
      if (request.back_to !== undefined)
        list.splice(0, list.length, ...versions.get(request.back_to as number)!.trajectories);
      else if (request.remove) list.splice(request.trajectory as number, 1);
      else if (!request.save)
        list[request.trajectory as number] = {
          ...list[request.trajectory as number]!,
          ...(request as object),
        } as Trajectory;
      now = { ...now, version: now.version + 1, trajectories: list, saved: request.save === true };
      versions.set(now.version, now);
      store.update(now);
      return true;
    },
    () => may.ask,
  );
  store.update(now);
  return { history, asked, may, store, names: () => store.list.map(({ name }) => name) };
}
const later = () => new Promise((done) => setTimeout(done, 0));

test("each change and undo of a shared plan is requested", async () => {
  const { history, asked, store, names } = shared();
  store.add([1, 2, 3], [4, 5, 6]);
  await later();
  assert.deepEqual(asked.at(-1), {
    version: 3,
    trajectory: 1,
    name: "Trajectory 2",
    entry_mm: [1, 2, 3],
    target_mm: [4, 5, 6],
  });
  assert.deepEqual([names(), store.chosen.value], [["hole", "Trajectory 2"], 1]);
  store.remove(0);
  await later();
  assert.deepEqual([names(), store.chosen.value], [["Trajectory 2"], 0]);
  await history.undo();
  assert.deepEqual(names(), ["hole", "Trajectory 2"]);
  assert.equal(store.list[0]!.target_within_mm, 1.5, "with what is allowed");
  await history.undo();
  assert.deepEqual(names(), ["hole"]);
  await history.redo();
  assert.deepEqual(names(), ["hole", "Trajectory 2"]);
  await store.save();
  assert.equal(store.plan!.saved, true);
});

test("a refused change is not applied and is not an undo step", async () => {
  const { history, may, store, names } = shared();
  may.refuses = true;
  store.add([1, 2, 3], [4, 5, 6]);
  await later();
  assert.deepEqual([names(), history.canUndo.value], [["hole"], false]);
});

test("a page without permission or a shared plan has its own plan", async () => {
  const { history, asked, may, store, names } = shared();
  may.ask = false;
  store.addTowards([0, 0, 0], [0, 30, 0]);
  assert.deepEqual([names(), asked.length, store.isOwn], [["hole", "Trajectory 2"], 0, true]);
  assert.deepEqual(store.list[1]!.target_mm, [0, 20, 0]);
  await history.undo();
  assert.deepEqual([names(), store.isOwn], [["hole"], false]);
  await history.redo();
  may.ask = true;
  assert.deepEqual(names(), ["hole"], "palpate's where it may again");
  const alone = new PlanStore(
    new History(),
    async () => assert.fail(),
    () => true,
  );
  alone.add([0, 0, 0], [0, 0, 5]);
  alone.add([0, 0, 1], [0, 0, 6]);
  alone.remove(0);
  alone.add([0, 0, 2], [0, 0, 7]);
  assert.deepEqual(
    alone.list.map(({ name }) => name),
    ["Trajectory 2", "Trajectory 3"],
    "each name is its own",
  );
  alone.forget();
  assert.equal(alone.plan, null);
});

test("two presses or a drag add a trajectory, and an end can be dragged", () => {
  const store = new PlanStore(
    new History(),
    async () => assert.fail(),
    () => false,
  );
  // projection of one pixel per millimetre
  const from =
    (at: Vec3) =>
    (p: Vec3): number =>
      length(sub(p, at));
  const press = (at: Vec3) => store.press(at, from(at));
  const release = (at: Vec3) => store.release(at, from(at));
  press([0, 0, 0]);
  release([1, 0, 0]);
  assert.deepEqual([store.list.length, store.drawn.length], [0, 1], "begun");
  press([0, 0, 50]);
  release([0, 0, 50]);
  assert.deepEqual(
    [store.list[0]!.entry_mm, store.list[0]!.target_mm],
    [
      [0, 0, 0],
      [0, 0, 50],
    ],
  );
  press([100, 0, 0]);
  release([100, 30, 0]);
  assert.deepEqual(
    [store.list[1]!.entry_mm, store.list[1]!.target_mm],
    [
      [100, 0, 0],
      [100, 30, 0],
    ],
  );
  // a press near the first trajectory's target picks it
  press([0, 3, 52]);
  store.move([0, 40, 60]);
  assert.deepEqual(
    [store.drawn[0]!.target_mm, store.list[0]!.target_mm, store.chosen.value],
    [[0, 40, 60], [0, 0, 50], 0],
  );
  release([0, 40, 60]);
  assert.deepEqual(store.list[0]!.target_mm, [0, 40, 60]);
  // a press on an end without movement selects the trajectory
  press([100, 31, 0]);
  release([100, 31, 0]);
  assert.deepEqual([store.chosen.value, store.list[1]!.target_mm, store.list.length], [1, [100, 30, 0], 2]);
  press([0, 200, 0]);
  store.drop();
  assert.deepEqual([store.drawn.length, dot(store.list[0]!.entry_mm, [1, 1, 1])], [2, 0]);
});
