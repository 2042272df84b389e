import assert from "node:assert/strict";
import test from "node:test";
import type { State } from "../src/protocol/messages.js";
import type { Pose } from "../src/protocol/wire.js";
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
  const asked: object[] = [];
  performance.now = () => now;
  Object.assign(globalThis, {
    window: {
      setInterval: (f: () => void) => {
        beat = f;
        return 1;
      },
    },
  });
  const session = new Session();
  session.pose.value = { devices: [{ tip: [0, 0, 0] }] } as unknown as Pose;
  session.state.value = { pointer: true } as State;
  const permission = { device: { value: true } };
  const device = new PointerDevice(
    session,
    { moveTip: (p: number[]) => sent.push(p) } as unknown as Device[1],
    permission as unknown as Device[2],
    { once: async (request: object) => (asked.push(request), isGranted) } as unknown as Device[3],
  );
  const at = (ms: number) => {
    while (now < ms) {
      now += 8;
      if (session.holding.value) beat!();
    }
  };
  return { device, session, sent, asked, permission, at };
}

test("a finger moves the tip only after the delay for a second finger", () => {
  const { device, sent, at } = pointer();
  device.hold([40, 0, 0], true);
  at(140);
  device.release();
  at(1000);
  assert.deepEqual(sent, []);
  device.hold([40, 0, 0], true);
  at(1400);
  assert.ok(sent.length > 0 && sent[0]![0]! < 5, "it goes there no faster than a hand");
  assert.deepEqual(sent.at(-1), [40, 0, 0]);
});

test("a mouse moves the tip at once", () => {
  const { device, sent, at } = pointer();
  device.hold([1, 0, 0], false);
  at(48);
  assert.deepEqual(sent.at(-1), [1, 0, 0]);
});

test("presses in two pictures release the tip", () => {
  const { device, session, sent, at } = pointer();
  device.hold([1, 0, 0], false);
  at(48);
  device.hold([90, 0, 0], false);
  const before = sent.length;
  device.move([50, 0, 0]);
  at(500);
  assert.equal(session.holding.value, false);
  assert.equal(sent.length, before);
});

const held = (by: State["pointer_by"]) => ({ pointer: by === "you", pointer_by: by }) as State;

test("a press takes a pointer that no viewer has, and moves the tip once it is granted", async () => {
  const { device, session, sent, asked, permission, at } = pointer();
  session.state.value = held("viewer");
  assert.equal(device.isAvailable, false);
  session.state.value = held(null);
  assert.equal(device.isAvailable, true);
  permission.device.value = false;
  assert.equal(device.isAvailable, false, "another learner's turn");
  permission.device.value = true;
  device.hold([40, 0, 0], false);
  at(400);
  assert.deepEqual(asked, [{ type: "pointer", take: true }]);
  assert.deepEqual(sent, [], "not before it is granted");
  session.state.value = held("you");
  await null;
  at(420);
  assert.ok(sent[0]![0]! > 0 && sent[0]![0]! < 5, "no jump after the wait");
  at(800);
  assert.deepEqual(sent.at(-1), [40, 0, 0]);
});

test("a press ends if the pointer is refused or passed to another viewer", async () => {
  const refused = pointer(false);
  refused.session.state.value = held(null);
  refused.device.hold([1, 0, 0], false);
  await new Promise((later) => setTimeout(later));
  assert.equal(refused.session.holding.value, false);

  const { device, session, sent, asked, at } = pointer();
  session.state.value = held("you");
  device.hold([1, 0, 0], false);
  at(48);
  session.state.value = held("viewer");
  const before = sent.length;
  at(100);
  assert.equal(session.holding.value, false);
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
