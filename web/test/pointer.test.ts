import assert from "node:assert/strict";
import test from "node:test";
import type { State } from "../src/protocol/messages.js";
import { Flag, type Pose } from "../src/protocol/wire.js";
import { Session } from "../src/state/session.js";
import { PointerDevice } from "../src/state/pointer.js";
import { shownAt } from "../src/drawing/measure.js";

type Device = ConstructorParameters<typeof PointerDevice>;

/**
 * Pointer device with a simulated clock: `at(ms)` advances it in steps of 8 ms, the timer's interval.
 * @param isGranted  answer to a request of the pointer
 */
function pointer(isGranted = true) {
  let now = 0,
    beat: (() => void) | null = null;
  const sent: number[][] = [];
  const pressed: number[] = []; // forces of the messages
  const setDowns: number[][] = [];
  const lifts = { count: 0, releaseByPause: 0 };
  const asked: object[] = [];
  performance.now = () => now;
  Object.assign(globalThis, {
    window: {
      setInterval: (f: () => void) => {
        beat = f;
        return 1;
      },
      setTimeout: (f: () => void) => f(),
    },
  });
  const session = new Session();
  session.pose.value = { devices: [{ tip: [0, 0, 0] }] } as unknown as Pose;
  session.state.value = { pointer: true } as State;
  const permission = { operateTool: { value: true } };
  const device = new PointerDevice(
    session,
    {
      moveTip: (p: number[], into?: number[], force_N?: number) => (sent.push(p), pressed.push(into ? force_N! : 0)),
      liftTip: () => (lifts.count += 1),
      setTipDown: (p: number[]) => (sent.push(p), pressed.push(0), setDowns.push(p)),
    } as unknown as Device[1],
    permission as unknown as Device[2],
    { once: async (request: object) => (asked.push(request), isGranted) } as unknown as Device[3],
  );
  const at = (ms: number) => {
    while (now < ms) {
      now += 8;
      if (session.isPressing.value) beat!();
    }
  };
  device.onReleasedByPause = () => (lifts.releaseByPause += 1);
  /** Time passes without the page running. */
  const stall = (ms: number) => {
    now += ms;
  };
  return { device, session, sent, pressed, lifts, setDowns, asked, permission, at, stall, time: () => now };
}

test("a finger moves the tip only after the delay for a second finger", () => {
  const { device, sent, at } = pointer();
  device.hold([{ at: [40, 0, 0], into: null }], true);
  at(140);
  device.release();
  at(1000);
  assert.deepEqual(sent, []);
  device.hold([{ at: [40, 0, 0], into: null }], true);
  at(1400);
  assert.ok(sent.length > 0 && sent[0]![0]! < 5, "it goes there no faster than a hand");
  assert.deepEqual(sent.at(-1), [40, 0, 0]);
});

test("a mouse moves the tip at once", () => {
  const { device, sent, at } = pointer();
  device.hold([{ at: [1, 0, 0], into: null }], false);
  at(48);
  assert.deepEqual(sent.at(-1), [1, 0, 0]);
});

test("presses in two pictures release the tip", () => {
  const { device, session, sent, at } = pointer();
  device.hold([{ at: [1, 0, 0], into: null }], false);
  at(48);
  device.hold([{ at: [90, 0, 0], into: null }], false);
  const before = sent.length;
  device.move({ at: [50, 0, 0], into: null });
  at(500);
  assert.equal(session.isPressing.value, false);
  assert.equal(sent.length, before);
});

const pointerState = (by: State["pointer_by"]) => ({ pointer: by === "you", pointer_by: by }) as State;

test("a path is followed through all its points, with force on the surface alone", () => {
  const { device, sent, pressed, session, at } = pointer();
  session.press_N.value = 0.7;
  device.hold(
    [
      { at: [0, 0, 9], into: null },
      { at: [9, 0, 9], into: null },
      { at: [9, 0, 0], into: [0, 0, -1] },
    ],
    false,
  );
  at(400);
  const corner = sent.findIndex(([x, , z]) => x === 9 && z === 9);
  assert.ok(corner > 0 && sent.slice(0, corner).every(([x, , z]) => x === 0 || z === 9), "no corner is cut");
  assert.deepEqual(sent.at(-1), [9, 0, 0]);
  assert.ok(sent.every(([, , z], n) => pressed[n] === (z === 0 && sent[n]![0] === 9 ? 0.7 : 0)));
  // over a surface it keeps up with a fast hand
  device.follow(Array.from({ length: 100 }, (_, n) => ({ at: [10 + n, 0, 0], into: [0, 0, -1] })));
  at(600);
  assert.deepEqual(sent.at(-1), [109, 0, 0]);
  assert.ok(pressed.slice(-10).every((force_N) => force_N === 0.7));
});

test("over a surface a late timer leaves out no more than 10 mm of the path", () => {
  const { device, sent, at, stall, time } = pointer();
  device.hold([{ at: [0, 0, 0], into: [0, 0, -1] }], false);
  at(100);
  for (let n = 0; n < 20; n++) {
    const before = sent.length;
    device.follow(Array.from({ length: 20 }, (_, step) => ({ at: [20 * n + step + 1, 0, 0], into: [0, 0, -1] })));
    stall(40);
    at(time() + 160);
    for (let k = before; k < sent.length; k++) assert.ok(sent[k]![0]! - sent[k - 1]![0]! <= 10 + 1e-9);
    assert.deepEqual(sent.at(-1), [20 * n + 20, 0, 0], "and it arrives");
  }
});

test("a tip that is set down elsewhere covers no path in between", () => {
  const { device, sent, setDowns, at } = pointer();
  device.hold([{ at: [1, 0, 0], into: [1, 0, 0] }], false);
  at(100);
  device.follow([
    { at: [0, 0, 0], into: null },
    { at: [0, 90, 0], into: null, isSetDown: true },
    { at: [1, 90, 0], into: [1, 0, 0] },
  ]);
  at(200);
  assert.deepEqual(setDowns, [[0, 90, 0]]);
  assert.deepEqual(sent.at(-1), [1, 90, 0]);
  assert.ok(sent.every(([, y]) => y === 0 || y === 90));
  const back = sent.findIndex(([, y]) => y === 90);
  assert.deepEqual(sent[back - 1], [0, 0, 0], "it has left the surface before");
  assert.deepEqual(sent[back], [0, 90, 0]);
  // a diversion drops the remaining path
  device.follow([{ at: [1, 200, 0], into: [1, 0, 0] }]);
  device.divert([{ at: [0, 50, 0], into: null, isSetDown: true }]);
  at(300);
  assert.deepEqual(sent.at(-1), [0, 50, 0]);
  assert.deepEqual(setDowns.at(-1), [0, 50, 0]);
});

test("stalls of 50 to 400 ms do not end a hold, 200 times", () => {
  const { device, session, lifts, sent, at, stall, time } = pointer();
  const seed = Date.now() % 1e6;
  let state = seed;
  const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
  device.hold([{ at: [1, 0, 0], into: [1, 0, 0] }], false);
  at(100);
  for (let n = 0; n < 200; n++) {
    stall(50 + 350 * random());
    at(time() + 100 * random() + 16);
  }
  assert.equal(session.isPressing.value, true, `seed ${seed}`);
  assert.deepEqual(lifts, { count: 0, releaseByPause: 0 }, `seed ${seed}`);
  assert.deepEqual(sent.at(-1), [1, 0, 0]);
});

test("after a longer stall, and when the page is hidden, the hold ends with a message", () => {
  for (const ms of [1000, 2000, 10_000, 0]) {
    const { device, session, lifts, sent, at, stall, time } = pointer();
    device.hold([{ at: [1, 0, 0], into: [1, 0, 0] }], false);
    at(100);
    const before = sent.length;
    if (ms === 0) device.releaseByPause();
    else stall(ms);
    at(time() + 16);
    assert.equal(session.isPressing.value, false);
    assert.deepEqual(lifts, { count: 1, releaseByPause: 1 });
    assert.deepEqual(sent.slice(before), [[-1, 0, 0]], "it leaves the surface, which would stay dented");
  }
});

test("a stall on the way to the surface does not end the press", () => {
  const { device, session, lifts, sent, at, stall, time } = pointer();
  device.hold(
    [
      { at: [40, 0, 0], into: null },
      { at: [41, 0, 0], into: [1, 0, 0] },
    ],
    false,
  );
  at(40);
  assert.ok(sent.length > 0 && sent.at(-1)![0]! < 40);
  stall(2000);
  at(time() + 400);
  assert.equal(session.isPressing.value, true);
  assert.deepEqual(lifts, { count: 0, releaseByPause: 0 });
  assert.deepEqual(sent.at(-1), [41, 0, 0]);
});

test("without force while it is withheld, and never above the limit", () => {
  const { device, session, pressed, at } = pointer();
  session.state.value = { pointer: true, max_force_N: 0.5 } as State;
  device.hold([{ at: [1, 0, 0], into: [1, 0, 0] }], false);
  at(100);
  assert.equal(pressed.at(-1), 0.5);
  session.pose.value = { devices: [{ tip: [0, 0, 0], flags: Flag.paused }] } as unknown as Pose;
  at(200);
  assert.equal(pressed.at(-1), 0);
});

test("a press takes a pointer that no viewer has, and moves the tip once it is granted", async () => {
  const { device, session, sent, asked, permission, at } = pointer();
  session.state.value = pointerState("viewer");
  assert.equal(device.isAvailable, false);
  session.state.value = pointerState(null);
  assert.equal(device.isAvailable, true);
  permission.operateTool.value = false;
  assert.equal(device.isAvailable, false, "another learner's turn");
  permission.operateTool.value = true;
  device.hold([{ at: [40, 0, 0], into: null }], false);
  at(400);
  assert.deepEqual(asked, [{ type: "pointer", take: true }]);
  assert.deepEqual(sent, [], "not before it is granted");
  session.state.value = pointerState("you");
  await null;
  at(420);
  assert.ok(sent[0]![0]! > 0 && sent[0]![0]! < 5, "no jump after the wait");
  at(800);
  assert.deepEqual(sent.at(-1), [40, 0, 0]);
});

test("a press ends if the pointer is refused or passed to another viewer", async () => {
  const refused = pointer(false);
  refused.session.state.value = pointerState(null);
  refused.device.hold([{ at: [1, 0, 0], into: null }], false);
  await new Promise((later) => setTimeout(later));
  assert.equal(refused.session.isPressing.value, false);

  const { device, session, sent, asked, at } = pointer();
  session.state.value = pointerState("you");
  device.hold([{ at: [1, 0, 0], into: null }], false);
  at(48);
  session.state.value = pointerState("viewer");
  const before = sent.length;
  at(100);
  assert.equal(session.isPressing.value, false);
  assert.equal(sent.length, before);
  assert.deepEqual(asked, []);
});

test("a measurement is opaque in its plane, faint with its distance near it and hidden far away", () => {
  assert.deepEqual(shownAt(0.2, 0.25), { strength: 1, off: "" });
  const [near, far] = [shownAt(1.2, 0.25)!, shownAt(11, 0.25)!];
  assert.ok(near.strength < 0.5 && far.strength < near.strength && far.strength > 0.1);
  assert.equal(near.off, " · 1.20 mm from this plane");
  assert.equal(shownAt(12.5, 0.25), null);
});
