import assert from "node:assert/strict";
import test from "node:test";
import { Connection, type Link } from "../src/protocol/connection.js";
import type { DeformationMessage } from "../src/protocol/deformation_message.js";
import { VolumeNotFound, isMemoryShort, PermanentError, NoMemory, errorOf } from "../src/words/errors.js";

/** Connection with simulated sockets and timers, and its messages. */
function connection() {
  const sockets: {
    readyState: number;
    onopen(): void;
    onclose(event: { code: number }): void;
    onmessage(event: { data: unknown }): void;
  }[] = [];
  const timers: { f(): void; ms: number }[] = [];
  const sent: { type: string; id?: number; task?: boolean }[] = [];
  const isAnswered = { goodbye: true };
  class Socket {
    onopen = () => {};
    onclose = (_: { code: number }) => {};
    static OPEN = 1;
    onmessage = (_: { data: unknown }) => {};
    readyState = 1;
    constructor() {
      sockets.push(this);
    }
    // without a response, the closing handshake stays incomplete
    close() {
      this.readyState = 2;
      if (isAnswered.goodbye) this.onclose({ code: 1005 });
    }
    send(text: string) {
      if (this.readyState === 1) sent.push(JSON.parse(text));
    }
  }
  Object.assign(globalThis, {
    WebSocket: Socket,
    location: { protocol: "http:", host: "h" },
    window: { setTimeout: (f: () => void, ms: number) => timers.push({ f, ms }) },
  });
  const links: Link[] = [];
  const deformations: DeformationMessage[] = [];
  const tasks: number[] = [],
    nears: number[] = [],
    tracks: number[] = [];
  const received = { otherProtocol: 0, unanswered: 0, problems: 0 };
  const made = new Connection(
    {
      onLink: (link) => links.push(link),
      onState() {},
      onPose() {},
      onToken() {},
      onAsked() {},
      onCut() {},
      onDeformation: (one) => deformations.push(one),
      onNear: (near) => nears.push(near[0]!.noGo),
      onPlan: (plan) => tasks.push(100 + plan.version),
      onTracked: (tracked) => tracks.push(tracked.fre_mm),
      onTask: (run) => tasks.push(run.run),
      onDebriefing: (one) => tasks.push(-one.run),
      onProblem: () => void received.problems++,
      onOtherProtocol: () => void received.otherProtocol++,
      onUnanswered: () => void received.unanswered++,
    },
    null,
  );
  made.open();
  return { made, sockets, timers, sent, links, received, deformations, tasks, nears, tracks, isAnswered };
}
const WELCOME = {
  data: JSON.stringify({ type: "welcome", role: "control", learner: null, may: ["look", "stop", "hand"], protocol: 3 }),
};
function pose(version: number): { data: ArrayBuffer } {
  const view = new DataView(new ArrayBuffer(392));
  "PLPT".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, version, true);
  return { data: view.buffer as ArrayBuffer };
}

test("temporary errors are retried at increasing intervals", () => {
  for (const code of [1001, 1006, 1013, 4408, 4429]) {
    const { sockets, timers, received } = connection();
    for (let n = 0; n < 8; n++) {
      sockets.at(-1)!.onclose({ code });
      assert.equal(timers.length, n + 1, `after ${code}`);
      timers.at(-1)!.f();
    }
    assert.ok(timers[0]!.ms < 400 && timers[7]!.ms > 3000 && timers[7]!.ms <= 6000);
    assert.equal(received.unanswered, 7, "that it may last is asked from the second time on");
    assert.equal(received.otherProtocol, 0);
  }
});

test("a lesson that the teacher has ended is neither lost nor connected again", () => {
  const { made, sockets, timers, links, received } = connection();
  const state = (over: boolean) => ({ data: JSON.stringify({ type: "state", lesson: { over } }) });
  sockets[0]!.onmessage(WELCOME);
  sockets[0]!.onmessage(state(false));
  sockets[0]!.onmessage(state(true));
  sockets[0]!.onclose({ code: 1001 });
  assert.deepEqual([links.at(-1), timers.length, received.unanswered], ["over", 0, 0]);
  // another session at the same address
  made.open();
  sockets[1]!.onmessage(WELCOME);
  sockets[1]!.onclose({ code: 1001 });
  assert.deepEqual([links.at(-1), timers.length], ["lost", 1]);
});

test("a stop without a connection is sent to the next one within its time limit", async (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  const stops = (after_ms: number, type: "stop" | "set") => {
    const { made, sockets, sent } = connection();
    void made.request({ type });
    now += after_ms;
    sockets[0]!.onmessage(WELCOME);
    const before = sent.length;
    // a later connection does not repeat it
    sockets[0]!.onmessage(WELCOME);
    assert.equal(sent.length, before);
    return sent.map((message) => message.type);
  };
  assert.deepEqual(stops(4900, "stop"), ["stop"]);
  assert.deepEqual(stops(5100, "stop"), []);
  assert.deepEqual(stops(100, "set"), []);
  const refusal = await connection().made.request({ type: "stop" });
  assert.match(refusal!.what, /within 5 s/);
});

test("an unanswered stop is sent to the next connection within its time limit", async (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  for (const [pressedAfter_ms, comesAgain] of [
    [2000, false],
    [4500, true],
  ] as const) {
    const { made, sockets, timers, sent, isAnswered } = connection();
    sockets[0]!.onmessage(WELCOME);
    // the server vanishes without a closing handshake
    isAnswered.goodbye = false;
    now += pressedAfter_ms;
    const answer = made.request({ type: "stop" });
    now += 6100 - pressedAfter_ms;
    made.watch();
    assert.match((await answer)!.what, /within 5 s/);
    assert.equal(made.link.value, "lost", "before the goodbye has come to an end");
    now += 1000;
    timers.at(-1)!.f();
    sockets[1]!.onmessage(WELCOME);
    assert.deepEqual(
      sent.map(({ type }) => type),
      comesAgain ? ["stop", "stop"] : ["stop"],
    );
  }
});

test("a stop on a closing connection is queued", async (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  const { made, sockets, sent } = connection();
  sockets[0]!.onmessage(WELCOME);
  sockets[0]!.readyState = 2;
  assert.match((await made.request({ type: "stop" }))!.what, /within 5 s/);
  assert.ok((await made.request({ type: "set" })) !== null);
  assert.equal(sent.length, 0);
  sockets[0]!.onclose({ code: 1006 });
  now += 300;
  made.open();
  sockets[1]!.onmessage(WELCOME);
  assert.deepEqual(
    sent.map(({ type }) => type),
    ["stop"],
  );
  // an acknowledged stop is not sent again
  sockets[1]!.onmessage({ data: JSON.stringify({ type: "done", id: sent[0]!.id }) });
  sockets[1]!.onclose({ code: 1006 });
  made.open();
  sockets[2]!.onmessage(WELCOME);
  assert.equal(sent.length, 1);
});

test("a connection attempt times out", (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  const { made, timers, isAnswered } = connection();
  isAnswered.goodbye = false;
  now += 19_000;
  made.watch();
  assert.equal(timers.length, 0);
  now += 1100;
  made.watch();
  assert.equal(made.link.value, "lost");
  assert.equal(timers.length, 1);
});

test("another protocol version is not retried automatically", () => {
  for (const isSpoken of [false, true]) {
    const { made, sockets, timers, received } = connection();
    if (isSpoken) {
      sockets[0]!.onmessage(WELCOME);
      sockets[0]!.onmessage(pose(4));
    } else sockets[0]!.onclose({ code: 4406 });
    assert.equal(made.link.value, "ended");
    assert.deepEqual([timers.length, sockets.length, received.otherProtocol], [0, 1, 1]);
    made.open();
    sockets[1]!.onmessage(WELCOME);
    assert.equal(made.link.value, "connected");
  }
});

test("connections with invalid poses are retried at increasing intervals", () => {
  const { sockets, timers, received } = connection();
  for (let n = 0; n < 8; n++) {
    sockets.at(-1)!.onmessage(WELCOME);
    sockets.at(-1)!.onmessage({ data: new ArrayBuffer(7) });
    timers.at(-1)!.f();
  }
  assert.equal(received.problems, 8);
  assert.ok(timers[7]!.ms > 3000);
});

test("HTTP errors are permanent or temporary", () => {
  for (const status of [400, 403, 404, 405, 413, 421, 431]) {
    const error = errorOf("/api/scene", status);
    assert.ok(error instanceof PermanentError && error.message.includes(String(status)) && error.remedy.length > 20);
  }
  for (const status of [408, 429, 500, 502, 503]) assert.ok(!(errorOf("/api/scene", status) instanceof PermanentError));
  assert.ok(errorOf("/api/volume/scan/0f3a", 404) instanceof VolumeNotFound);
  assert.ok(
    isMemoryShort(new NoMemory()) &&
      isMemoryShort(new RangeError("Array buffer allocation failed")) &&
      !isMemoryShort(new TypeError("fetch")),
  );
});

test("deformation messages are decoded, and an invalid one ends the connection like an invalid pose", () => {
  const { sockets, deformations, received, links } = connection();
  sockets[0]!.onmessage(WELCOME);
  const view = new DataView(new ArrayBuffer(96));
  "PLPY".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, 3, true);
  view.setUint32(8, 96, true);
  sockets[0]!.onmessage({ data: view.buffer });
  assert.deepEqual(
    deformations.map(({ device, nodes }) => [device, nodes]),
    [[0, null]],
  );
  view.setUint32(8, 97, true);
  sockets[0]!.onmessage({ data: view.buffer });
  assert.equal(received.problems, 1);
  assert.equal(links.at(-1), "lost");
  assert.equal(deformations.length, 1);
});

test("task runs are requested and delivered in order", () => {
  const { sockets, sent, tasks } = connection();
  sockets[0]!.onopen();
  assert.equal(sent[0]!.task, true);
  sockets[0]!.onmessage(WELCOME);
  for (const message of [
    { type: "task", run: 3 },
    { type: "debriefing", run: 3 },
    { type: "task", run: 4 },
  ])
    sockets[0]!.onmessage({ data: JSON.stringify(message) });
  assert.deepEqual(tasks, [3, -3, 4]);
});

test("distances are requested and delivered apart from poses", () => {
  const { sockets, sent, nears, received } = connection();
  sockets[0]!.onopen();
  assert.equal((sent[0] as { near?: boolean }).near, true);
  sockets[0]!.onmessage(WELCOME);
  const view = new DataView(new ArrayBuffer(100));
  "PLPN".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, 3, true);
  view.setUint16(6, 100, true);
  view.setUint16(16, 1, true);
  view.setUint16(24, 2, true);
  sockets[0]!.onmessage({ data: view.buffer });
  assert.deepEqual(nears, [1]);
  view.setUint16(16, 2, true);
  sockets[0]!.onmessage({ data: view.buffer });
  assert.deepEqual([nears.length, received.problems], [1, 1], "of more devices than it has room for");
});

test("the registration error of a tracked tip is requested and delivered", () => {
  const { sockets, sent, tracks } = connection();
  sockets[0]!.onopen();
  assert.equal((sent[0] as { navigation?: boolean }).navigation, true);
  sockets[0]!.onmessage(WELCOME);
  sockets[0]!.onmessage({
    data: JSON.stringify({
      type: "navigation",
      device: 0,
      seen: true,
      fre_mm: 0.3,
      tre_mm: 0.8,
      tre_95_mm: 1.4,
      far: false,
    }),
  });
  assert.deepEqual(tracks, [0.3]);
});
