import assert from "node:assert/strict";
import test from "node:test";
import { Connection, type Link } from "../src/connection.js";
import { Gone, isMemoryShort, Lasting, NoMemory, troubleOf } from "../src/trouble.js";

/** A connection whose sockets and timers are the test's. */
function connection() {
  const sockets: { onclose(event: { code: number }): void; onmessage(event: { data: unknown }): void }[] = [];
  const timers: { f(): void; ms: number }[] = [];
  const sent: { type: string }[] = [];
  class Socket {
    onclose = (_: { code: number }) => {};
    onmessage = (_: { data: unknown }) => {};
    constructor() { sockets.push(this); }
    close() { this.onclose({ code: 1005 }); }
    send(text: string) { sent.push(JSON.parse(text)); }
  }
  Object.assign(globalThis, {
    WebSocket: Socket, location: { protocol: "http:", host: "h" },
    window: { setTimeout: (f: () => void, ms: number) => timers.push({ f, ms }) },
  });
  const links: Link[] = [];
  const told = { otherProtocol: 0, unanswered: 0, problems: 0 };
  const made = new Connection({
    onLink: (link) => links.push(link), onState() {}, onPose() {}, onToken() {}, onAsked() {}, onProblem: () => void told.problems++,
    onOtherProtocol: () => void told.otherProtocol++, onUnanswered: () => void told.unanswered++,
  }, null);
  made.open();
  return { made, sockets, timers, sent, links, told };
}
const WELCOME = { data: JSON.stringify({ type: "welcome", role: "control", protocol: 2 }) };
function pose(version: number): { data: ArrayBuffer } {
  const view = new DataView(new ArrayBuffer(272));
  "PLPT".split("").forEach((letter, i) => view.setUint8(i, letter.charCodeAt(0)));
  view.setUint16(4, version, true);
  return { data: view.buffer as ArrayBuffer };
}

test("what passes is tried again, ever more seldom", () => {
  for (const code of [1001, 1006, 1013, 4408, 4429]) {
    const { sockets, timers, told } = connection();
    for (let n = 0; n < 8; n++) {
      sockets.at(-1)!.onclose({ code });
      assert.equal(timers.length, n + 1, `after ${code}`);
      timers.at(-1)!.f();
    }
    assert.ok(timers[0]!.ms < 400 && timers[7]!.ms > 3000 && timers[7]!.ms <= 6000);
    assert.equal(told.unanswered, 7, "that it may last is asked from the second time on");
    assert.equal(told.otherProtocol, 0);
  }
});

test("a stop without a connection is sent to the next one, if that comes soon", async (t) => {
  let now = 1000;
  t.mock.method(performance, "now", () => now);
  const stops = (after_ms: number, type: "stop" | "set") => {
    const { made, sockets, sent } = connection();
    void made.ask({ type });
    now += after_ms;
    sockets[0]!.onmessage(WELCOME);
    const before = sent.length;
    // and to no further one
    sockets[0]!.onmessage(WELCOME);
    assert.equal(sent.length, before);
    return sent.map((message) => message.type);
  };
  assert.deepEqual(stops(4900, "stop"), ["stop"]);
  assert.deepEqual(stops(5100, "stop"), []);
  assert.deepEqual(stops(100, "set"), []);
  const refusal = await connection().made.ask({ type: "stop" });
  assert.match(refusal!.what, /within 5 s/);
});

test("another version of the protocol is not tried again by itself", () => {
  for (const isSpoken of [false, true]) {
    const { made, sockets, timers, told } = connection();
    if (isSpoken) {
      sockets[0]!.onmessage(WELCOME);
      sockets[0]!.onmessage(pose(3));
    } else sockets[0]!.onclose({ code: 4406 });
    assert.equal(made.link, "ended");
    assert.deepEqual([timers.length, sockets.length, told.otherProtocol], [0, 1, 1]);
    made.open();
    sockets[1]!.onmessage(WELCOME);
    assert.equal(made.link, "connected");
  }
});

test("a server whose poses cannot be read is asked ever more seldom, too", () => {
  const { sockets, timers, told } = connection();
  for (let n = 0; n < 8; n++) {
    sockets.at(-1)!.onmessage(WELCOME);
    sockets.at(-1)!.onmessage({ data: new ArrayBuffer(7) });
    timers.at(-1)!.f();
  }
  assert.equal(told.problems, 8);
  assert.ok(timers[7]!.ms > 3000);
});

test("an answer of HTTP is trouble that lasts, or passes", () => {
  for (const status of [400, 403, 404, 405, 413, 421, 431]) {
    const trouble = troubleOf("/api/scene", status);
    assert.ok(trouble instanceof Lasting && trouble.message.includes(String(status)) && trouble.how.length > 20);
  }
  for (const status of [408, 429, 500, 502, 503]) assert.ok(!(troubleOf("/api/scene", status) instanceof Lasting));
  assert.ok(troubleOf("/api/volume/scan/0f3a", 404) instanceof Gone);
  assert.ok(isMemoryShort(new NoMemory()) && isMemoryShort(new RangeError("Array buffer allocation failed")) && !isMemoryShort(new TypeError("fetch")));
});
