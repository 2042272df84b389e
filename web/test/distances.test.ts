import type { DeviceTool, NoGo, Scene } from "../src/protocol/messages.js";
import assert from "node:assert/strict";
import test from "node:test";
import { ApproachSound, HEARD_FROM_MM, toneAt } from "../src/panels/approach_sound.js";
import { length, sub, type Vec3 } from "../src/base/geometry.js";
import { decodeDistances, isDistanceMessage, type DeviceDistances } from "../src/protocol/distances.js";
import { nearestNoGo, toolParts, type ToolPart } from "../src/state/no_go.js";
import { Session } from "../src/state/session.js";
import { WireError, WireVersion, type Pose } from "../src/protocol/wire.js";

/** Encoded message, by the table of docs/reference/viewer-messages.md. */
function written(devices: DeviceDistances[]): DataView {
  const view = new DataView(new ArrayBuffer(24 + 76 * devices.length));
  "PLPN".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, 3, true);
  view.setUint16(6, view.byteLength, true);
  view.setBigUint64(8, 1234n, true);
  view.setUint16(16, devices.length, true);
  devices.forEach(({ noGo, depth, force, structures }, n) => {
    const at = 24 + 76 * n;
    view.setUint16(at, noGo + 1, true);
    [depth, force].forEach((x, i) => view.setFloat32(at + 4 + 4 * i, x, true));
    structures.forEach(({ label, mm }, i) => {
      view.setUint16(at + 12 + 8 * i, label, true);
      view.setFloat32(at + 16 + 8 * i, mm, true);
    });
  });
  return view;
}
const decoded = (view: DataView) => decodeDistances(view.buffer as ArrayBuffer);
const NOTHING: DeviceDistances = { noGo: -1, depth: 0, force: 0, structures: [] };

test("distances are decoded as specified by the protocol", () => {
  const near: DeviceDistances[] = [
    {
      noGo: 4,
      depth: 1.25,
      force: 0.5,
      structures: Array.from({ length: 8 }, (_, n) => ({ label: 300 + n, mm: n - 1.5 })),
    },
    NOTHING,
  ];
  assert.ok(isDistanceMessage(written(near).buffer as ArrayBuffer));
  assert.deepEqual(decoded(written(near)), near);
  const other = written(near);
  other.setUint16(4, 4, true);
  assert.throws(() => decoded(other), WireVersion);
  for (const [at, value] of [
    [0, 0],
    [6, 175],
    [16, 0],
    [16, 5],
    [16, 1],
  ] as const) {
    const broken = written(near);
    broken.setUint16(at, value, true);
    assert.throws(() => decoded(broken), WireError, `${at}`);
  }
  assert.throws(() => decodeDistances(new ArrayBuffer(23)), WireError);
});

const PROBE = { radius_mm: 1.5, points_mm: [[0, 0, 0]], capsules: [] } as unknown as DeviceTool;
const SHAFT = {
  ...PROBE,
  capsules: [{ from_mm: [0, 0, 0], to_mm: [0, 0, 40], radius_mm: 0.5, end_radius_mm: 3 }],
} as unknown as DeviceTool;
const same = (v: Vec3): Vec3 => v;
const region = (of: Partial<NoGo>): NoGo => ({
  name: "there",
  keep_away_mm: 0,
  label: null,
  plane: null,
  ball: null,
  ...of,
});

/** Reference: minimum of a distance over the balls at many positions along each part. */
const leastOf = (parts: ToolPart[], of: (p: Vec3) => number): number =>
  Math.min(
    ...parts.flatMap(({ from, to, radii_mm: [first, last] }) =>
      Array.from({ length: 20001 }, (_, n) => {
        const t = n / 20000;
        return of(from.map((x, axis) => x + t * (to[axis]! - x)) as Vec3) - first - t * (last - first);
      }),
    ),
  );

test("the distance to planes and balls is that of the closest sphere of the tool", () => {
  const plane = region({ plane: { point_mm: [0, 0, -10], outward: [0, 0, 1] }, keep_away_mm: 2 });
  assert.ok(Math.abs(nearestNoGo([plane], toolParts(PROBE, [3, 4, 0], same), NOTHING)!.mm - 6.5) < 1e-9);
  const ball = region({ ball: { centre_mm: [0, 0, 12], radius_mm: 5 }, keep_away_mm: 1 });
  assert.ok(Math.abs(nearestNoGo([ball], toolParts(PROBE, [0, 0, 0], same), NOTHING)!.mm - 4.5) < 1e-9);
  // tip positions with the ball next to the shaft, which widens
  for (const tip of [
    [20, 0, -30],
    [15, -9, 0],
    [0, 25, 5],
  ] as Vec3[]) {
    const parts = toolParts(SHAFT, tip, ([x, y, z]) => [z, x, y]);
    const found = nearestNoGo([ball], parts, NOTHING)!.mm;
    assert.ok(
      Math.abs(found - Math.max(0, leastOf(parts, (p) => length(sub(p, [0, 0, 12]))) - 6)) < 1e-3,
      `${tip} ${found}`,
    );
    const away = nearestNoGo([plane], parts, NOTHING)!.mm;
    assert.ok(Math.abs(away - Math.max(0, leastOf(parts, ([, , z]) => z + 10) - 2)) < 1e-3, `${tip} ${away}`);
  }
});

test("the approach is the reported pushing region, else the nearest of the reported and computed ones", () => {
  const regions = [
    region({ label: 7, keep_away_mm: 2 }),
    region({ label: 9 }),
    region({ ball: { centre_mm: [0, 0, 30], radius_mm: 1 } }),
  ];
  const parts = toolParts(PROBE, [0, 0, 0], same);
  const near = (...structures: DeviceDistances["structures"]) => ({ ...NOTHING, structures });
  assert.deepEqual(nearestNoGo(regions, parts, near({ label: 7, mm: 5 }, { label: 9, mm: 6 })), {
    region: 0,
    mm: 3,
    pushes: false,
  });
  assert.deepEqual(nearestNoGo(regions, parts, near({ label: 9, mm: 2 }, { label: 7, mm: 5 })), {
    region: 1,
    mm: 2,
    pushes: false,
  });
  assert.deepEqual(nearestNoGo(regions, parts, near({ label: 8, mm: 1 })), { region: 2, mm: 27.5, pushes: false });
  assert.deepEqual(
    nearestNoGo([null, regions[1]!], parts, near({ label: 7, mm: 5 }, { label: 9, mm: 6 })),
    { region: 1, mm: 6, pushes: false },
    "not to be told",
  );
  assert.deepEqual(nearestNoGo(regions, parts, { ...near({ label: 7, mm: 1 }), noGo: 0, depth: 1 }), {
    region: 0,
    mm: -1,
    pushes: true,
  });
  assert.equal(nearestNoGo(regions, parts, { ...NOTHING, noGo: 3 }), null, "a region that the scene does not have");
  assert.equal(nearestNoGo([regions[0]!], parts, NOTHING), null);
});

test("beeps get faster and higher with proximity, and the tone is continuous while a region pushes", () => {
  assert.equal(toneAt(HEARD_FROM_MM), null);
  assert.equal(toneAt(NaN), null);
  let before = toneAt(9.99)!;
  for (let mm = 9.5; mm >= 0; mm -= 0.5) {
    const tone = toneAt(mm)!;
    assert.ok(tone.beeps_per_s > before.beeps_per_s && tone.frequency_Hz > before.frequency_Hz, `${mm}`);
    before = tone;
  }
  for (const mm of [-0.01, -1, -2, -3]) {
    const tone = toneAt(mm)!;
    assert.equal(tone.beeps_per_s, 0);
    assert.ok(tone.frequency_Hz > before.frequency_Hz);
    before = tone;
  }
  assert.deepEqual(toneAt(-30), toneAt(-3));
});

/** Simulated audio context, which records what is scheduled; `loud`: gain at a time. */
function audio() {
  const received = {
    state: "suspended",
    now: 0,
    started: 0,
    stopped: 0,
    events: [] as { to: number; at: number }[],
    frequency: 0,
  };
  class Context {
    get state() {
      return received.state;
    }
    get currentTime() {
      return received.now;
    }
    destination = {};
    resume() {
      received.state = "running";
    }
    createOscillator() {
      return {
        type: "",
        frequency: { setTargetAtTime: (to: number) => (received.frequency = to) },
        connect: (to: unknown) => to,
        start: () => received.started++,
        stop: () => received.stopped++,
      };
    }
    createGain() {
      return {
        connect() {},
        gain: {
          value: 1,
          cancelScheduledValues: (from: number) => (received.events = received.events.filter(({ at }) => at < from)),
          setTargetAtTime: (to: number, at: number) => received.events.push({ to, at }),
        },
      };
    }
  }
  Object.assign(globalThis, { AudioContext: Context });
  const loud = (at: number) => received.events.filter((event) => event.at <= at).at(-1)?.to ?? 0;
  return { received, loud };
}

test("no sound is played before it is switched on and the user has interacted with the page", () => {
  const { received } = audio();
  const sound = new ApproachSound();
  sound.update(-1);
  sound.wake();
  assert.deepEqual([sound.tone, received.started, received.state], [null, 0, "suspended"]);
  sound.switch(true);
  sound.update(-1);
  assert.ok(sound.isBlocked);
  assert.deepEqual([sound.tone, received.started], [null, 0]);
  sound.wake();
  sound.update(-1);
  assert.deepEqual([sound.tone!.beeps_per_s, received.started, sound.isBlocked], [0, 1, false]);
});

test("a continuous tone ends unless it is renewed, and immediately when silenced", () => {
  const { received, loud } = audio();
  const sound = new ApproachSound();
  sound.switch(true);
  sound.wake();
  for (received.now = 0; received.now < 1; received.now += 1 / 60) {
    sound.update(-1);
    assert.ok(loud(received.now) > 0 && loud(received.now + 0.2) > 0);
  }
  assert.equal(received.started, 1, "one voice goes on");
  assert.equal(loud(received.now + 0.5), 0);
  sound.silence();
  assert.deepEqual([loud(received.now), sound.tone, received.stopped], [0, null, 1]);
  sound.update(-1);
  assert.deepEqual([loud(received.now + 0.1) > 0, received.started], [true, 2]);
  sound.switch(false);
  sound.update(-1);
  assert.deepEqual([loud(received.now + 0.1), sound.tone, received.stopped], [0, null, 2]);
});

test("the number of beeps per second equals the tone's rate", () => {
  const { received, loud } = audio();
  const sound = new ApproachSound();
  sound.switch(true);
  sound.wake();
  let beeps = 0,
    was = 0;
  for (received.now = 0; received.now < 4; received.now += 1 / 60) {
    sound.update(5);
    const is = loud(received.now);
    if (is > 0 && was === 0) beeps++;
    was = is;
  }
  const wanted = 4 * toneAt(5)!.beeps_per_s;
  assert.ok(Math.abs(beeps - wanted) <= 0.1 * wanted + 1, `${beeps} of ${wanted}`);
  // an approach shortens the pause before the next beep
  received.now = 10;
  sound.update(9.9);
  received.now += 1 / 60;
  sound.update(0);
  received.now += 0.2;
  sound.update(0);
  assert.ok(loud(received.now) > 0);
});

test("a quiz hides names, and the distance to its target until the target pushes", () => {
  const made = new Session();
  made.scene.value = {
    structures: [
      { label: 7, name: "left_nodule", colour: [0, 0, 0], tissue: 0 },
      { label: 8, name: "skin", colour: [0, 0, 0], tissue: 0 },
    ],
    tissues: [{ touchable: true, friction: 0.1 }],
    tools: [PROBE],
    world_from_patient: [
      [1, 0, 0, 0],
      [0, 1, 0, 0],
      [0, 0, 1, 0],
      [0, 0, 0, 1],
    ],
    no_go: [region({ name: "the_nodule", label: 7, keep_away_mm: 1 })],
  } as unknown as Scene;
  made.appearances.value = made.scene.value.structures.map(() => ({ colour: [1, 2, 3], opacity: 0.5, visible: false }));
  const pose = {
    time: 1,
    rotation: [1, 0, 0, 0],
    devices: [{ number: 0, tip: [0, 0, 0], orientation: [1, 0, 0, 0], flags: 0 }],
  } as unknown as Pose;
  const labels = () => made.nearTo(pose.devices[0]!).map(({ label }) => label);
  const colour = () => [...made.appearance.value.palette.slice(4, 8)];
  made.near.value = [
    {
      ...NOTHING,
      structures: [
        { label: 7, mm: 3 },
        { label: 8, mm: 4 },
      ],
    },
  ];
  made.setPose(pose);
  assert.deepEqual(
    [made.approach.value, labels(), made.regionName(0)],
    [{ region: 0, mm: 2, pushes: false }, [7, 8], "the nodule"],
  );
  made.quiz.value = [7];
  made.setPose(pose);
  assert.deepEqual(
    [made.approach.value, labels(), made.regionName(0), made.structureName(8)],
    [null, [8], "a no-go region", "a structure"],
  );
  // the structure whose region pushes is highlighted unless it is concealed
  const before = made.appearance.value;
  made.near.value = [{ ...made.near.value[0]!, noGo: 0, depth: 0.5 }];
  made.setPose(pose);
  assert.deepEqual(
    [made.pushing.value, made.appearance.value !== before],
    [{ region: 0, mm: -0.5, pushes: true }, true],
  );
  assert.equal(colour()[3], 255);
  made.concealment.value = { values: [1], as: 2 };
  assert.equal(colour()[3], 0, "it looks as what lies around it");
});
