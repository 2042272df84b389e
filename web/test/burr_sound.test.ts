import assert from "node:assert/strict";
import test from "node:test";
import { signal } from "@preact/signals-core";
import { BurrSound, burrTone } from "../src/panels/burr_sound.js";
import type { Connection } from "../src/protocol/connection.js";
import { Flag, type DevicePose } from "../src/protocol/wire.js";
import type { Session } from "../src/state/session.js";

const BURR = { revolutions_per_s: 1000, flutes: 8, cuts: true };
const load = (cuttingForce: number, cuttingEnergy: number, flags = 0) =>
  ({ number: 0, cuttingForce, cuttingEnergy, flags }) as DevicePose;

test("pitch follows the speed, and loudness and colour follow load and density", () => {
  const idle = burrTone(BURR, load(0, 0));
  assert.deepEqual([idle.rotation_Hz, idle.edges_Hz, idle.edgesGain, idle.noiseGain], [1000, 8000, 0, 0]);
  assert.equal(burrTone({ revolutions_per_s: 3000, flutes: 8 }, load(0, 0)).edges_Hz, 12000);
  let before = idle;
  for (const newtons of [0.1, 0.3, 1, 3, 10]) {
    const tone = burrTone(BURR, load(newtons, 100));
    assert.ok(tone.noiseGain > before.noiseGain && tone.edgesGain > before.edgesGain);
    assert.ok(tone.noiseGain + tone.edgesGain < 0.25);
    before = tone;
  }
  before = burrTone(BURR, load(1, 0));
  for (const energy of [5, 20, 50, 100]) {
    const tone = burrTone(BURR, load(1, energy));
    assert.ok(tone.noise_Hz > before.noise_Hz && tone.noiseGain > before.noiseGain);
    before = tone;
  }
  assert.equal(before.noise_Hz, 4000);
  assert.ok(burrTone(BURR, load(1, 100, Flag.breakThrough)).breaksThrough);
});

interface Scheduled {
  to: number;
  at: number;
}
/** Audio parameter that records what is scheduled. */
class Parameter {
  value = 1;
  events: Scheduled[] = [];
  setTargetAtTime(to: number, at: number): void {
    this.events.push({ to, at });
  }
  setValueAtTime(to: number, at: number): void {
    this.setTargetAtTime(to, at);
  }
  exponentialRampToValueAtTime(to: number, at: number): void {
    this.setTargetAtTime(to, at);
  }
  cancelScheduledValues(from: number): void {
    this.events = this.events.filter(({ at }) => at < from);
  }
  /** Target value at a time. */
  targetAt(time: number): number {
    return this.events.filter(({ at }) => at <= time).at(-1)?.to ?? this.value;
  }
}

function set() {
  const heard = { now: 0, gains: [] as Parameter[], filters: [] as Parameter[], started: 0, stopped: 0, thuds: 0 };
  const node = () => ({ connect: <T>(to: T): T => to });
  const source = () => ({
    ...node(),
    type: "",
    loop: false,
    frequency: new Parameter(),
    start: () => heard.started++,
    stop: () => heard.stopped++,
  });
  class Context {
    state = "suspended";
    sampleRate = 8000;
    destination = {};
    get currentTime() {
      return heard.now;
    }
    resume() {
      this.state = "running";
    }
    createGain() {
      const gain = new Parameter();
      heard.gains.push(gain);
      return { ...node(), gain };
    }
    createOscillator = source;
    createBufferSource = source;
    createBuffer(_channels: number, length: number) {
      return { getChannelData: () => new Float32Array(length) };
    }
    createBiquadFilter() {
      const frequency = new Parameter();
      heard.filters.push(frequency);
      return { ...node(), type: "", frequency };
    }
  }
  Object.assign(globalThis, { AudioContext: Context });
  const session = {
    pose: signal({ devices: [load(0, 0)] }),
    state: signal({ motor_is_on: true, stop: null as number | null, paused: false, playback: null }),
    scene: signal({ tools: [BURR] }),
  };
  const connection = { link: signal("connected") };
  const sound = new BurrSound(session as unknown as Session, connection as unknown as Connection);
  return { heard, session, connection, sound };
}

test("nothing is played before the button is pressed, nor without a running motor", () => {
  const { heard, session, connection, sound } = set();
  session.pose.value = { devices: [load(1, 100)] };
  assert.deepEqual([sound.tone, heard.started], [null, 0]);
  sound.toggle();
  assert.ok(sound.tone && heard.started === 3);
  for (const change of [
    () => (session.state.value = { ...session.state.value, motor_is_on: false }),
    () => (session.state.value = { ...session.state.value, stop: 1 }),
    () => (session.state.value = { ...session.state.value, paused: true }),
    () => (connection.link.value = "lost"),
  ]) {
    const state = session.state.value;
    change();
    assert.equal(sound.tone, null);
    session.state.value = state;
    connection.link.value = "connected";
    assert.ok(sound.tone);
  }
  sound.toggle();
  assert.deepEqual([sound.tone, heard.started], [null, heard.stopped]);
});

test("a change of layer is in the sound with the pose that has it, and a sound that is not renewed ends", () => {
  const { heard, session, sound } = set();
  sound.toggle();
  session.pose.value = { devices: [load(1, 100)] };
  const [filter] = heard.filters,
    [master] = heard.gains;
  assert.equal(filter!.targetAt(0), 4000);
  heard.now = 0.016;
  session.pose.value = { devices: [load(1, 10)] };
  assert.ok(filter!.targetAt(0.016) < 1200);
  assert.deepEqual([master!.targetAt(0.2), master!.targetAt(0.4)], [1, 0]);
});

test("a break-through is heard once, however long it is reported", () => {
  const { heard, session, sound } = set();
  sound.toggle();
  const gains = heard.gains.length;
  for (const flags of [0, Flag.breakThrough, Flag.breakThrough, 0, Flag.breakThrough])
    session.pose.value = { devices: [load(1, 100, flags)] };
  assert.equal(heard.gains.length, gains + 2);
});
