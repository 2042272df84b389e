import assert from "node:assert/strict";
import test from "node:test";
import { decodePose, Flag, WireError } from "../src/protocol/wire.js";

/** Encoded pose, by the table of docs/reference/viewer-messages.md, with a different value in every field. */
function written(devices: number): DataView {
  const bytes = 96 + 296 * devices;
  const view = new DataView(new ArrayBuffer(bytes));
  "PLPT".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, 3, true);
  view.setUint16(6, bytes, true);
  view.setBigUint64(8, 4_294_967_301n, true); // exceeds 32 bits
  view.setBigUint64(16, 1234n, true);
  view.setFloat64(24, 56.78, true);
  view.setBigUint64(32, 9_000_000_000n, true);
  view.setUint32(40, 7, true);
  view.setUint8(44, 5);
  view.setUint8(45, 1 | 16);
  view.setUint8(46, devices);
  [0.5, -0.5, 0.5, -0.5, 1000.5, 19, 44, 190, 0.75].forEach((x, i) => view.setFloat32(48 + 4 * i, x, true));
  [11, 12, 13].forEach((x, i) => view.setUint32(84 + 4 * i, x, true));
  for (let d = 0; d < devices; d++) {
    const at = 96 + 296 * d;
    for (let i = 0; i < 22; i++) view.setFloat32(at + 4 * i, 100 * d + i, true);
    view.setUint32(at + 88, Flag.contact | Flag.stale, true);
    view.setUint32(at + 92, 3, true);
    view.setUint16(at + 96, 60001, true);
    view.setUint16(at + 98, 1250, true);
    view.setFloat32(at + 100, 80, true);
    for (let n = 0; n < 2; n++) {
      view.setUint16(at + 104 + 12 * n, 60001 + n, true);
      view.setFloat32(at + 108 + 12 * n, 1.5 + n, true);
      view.setFloat32(at + 112 + 12 * n, 0.25 + 0.5 * n, true);
      view.setUint16(at + 176 + 20 * n, 60001 + n, true);
      view.setUint16(at + 178 + 20 * n, n, true);
      for (let i = 0; i < 4; i++) view.setFloat32(at + 180 + 20 * n + 4 * i, 50 * d + 10 * n + i, true);
    }
  }
  return view;
}

test("a pose is decoded as specified by the protocol", () => {
  const pose = decodePose(written(2).buffer as ArrayBuffer);
  assert.equal(pose.sequence, 4_294_967_301);
  assert.equal(pose.tick, 1234);
  assert.equal(pose.time, 56.78);
  assert.equal(pose.clock, 9);
  assert.equal(pose.modelVersion, 7);
  assert.equal(pose.method, 5);
  assert.equal(pose.switches, 17);
  assert.deepEqual(pose.rotation, [0.5, -0.5, 0.5, -0.5]);
  assert.equal(pose.rate, 1000.5);
  assert.deepEqual(pose.lateness, { p50: 19, p99: 44, max: 190 });
  assert.equal(pose.compute, 0.75);
  assert.deepEqual([pose.skipped, pose.dropped, pose.stalls], [11, 12, 13]);
  assert.deepEqual(
    pose.devices.map(({ number }) => number),
    [0, 1],
  );
  const {
    tip,
    proxy,
    normal,
    orientation,
    force,
    requestedForce,
    forceLimit,
    heat,
    depth,
    speed,
    stiffness,
    flags,
    buttons,
    label,
    cuttingForce,
    cuttingEnergy,
  } = pose.devices[1]!;
  assert.deepEqual(
    [...tip, ...proxy, ...normal, ...orientation, ...force, requestedForce, forceLimit, heat, depth, speed, stiffness],
    Array.from({ length: 22 }, (_, i) => 100 + i),
  );
  assert.equal(flags, Flag.contact | Flag.stale);
  assert.equal(buttons, 3);
  assert.equal(label, 60001);
  assert.deepEqual([cuttingForce, cuttingEnergy], [1.25, 80]);
  assert.deepEqual(pose.devices[1]!.path, [
    { label: 60001, depth: 1.5, share: 0.25 },
    { label: 60002, depth: 2.5, share: 0.75 },
  ]);
  assert.deepEqual(pose.devices[1]!.contacts, [
    { label: 60001, part: 0, position: [50, 51, 52], force: 53 },
    { label: 60002, part: 1, position: [60, 61, 62], force: 63 },
  ]);
});

test("anything but a complete pose is refused", () => {
  const refused = (change: (view: DataView) => void) => {
    const view = written(1);
    change(view);
    assert.throws(() => decodePose(view.buffer as ArrayBuffer), WireError);
  };
  refused((view) => view.setUint8(0, 0x51));
  refused((view) => view.setUint16(4, 1, true));
  refused((view) => view.setUint16(6, 391, true));
  refused((view) => view.setUint8(46, 0));
  refused((view) => view.setUint8(46, 2));
  refused((view) => view.setUint8(46, 255));
  const whole = written(1).buffer as ArrayBuffer;
  for (let bytes = 0; bytes < whole.byteLength; bytes++)
    assert.throws(() => decodePose(whole.slice(0, bytes)), WireError);
});

test("random bytes are always refused", () => {
  let seed = Date.now() & 0x7fffffff;
  const began = seed;
  const random = () => (seed = (seed * 1103515245 + 12345) & 0x7fffffff);
  for (let i = 0; i < 20000; i++) {
    const view = written(1);
    for (let flips = 0; flips < 1 + (i % 5); flips++) view.setUint8(random() % view.byteLength, random() & 0xff);
    try {
      decodePose(view.buffer as ArrayBuffer);
    } catch (error) {
      assert.ok(error instanceof WireError, `seed ${began}: ${error}`);
    }
  }
});
