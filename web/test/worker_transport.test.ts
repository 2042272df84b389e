import assert from "node:assert/strict";
import test from "node:test";
import type { FromWorker, ToWorker } from "../src/worker/messages.js";
import { WorkerTransport } from "../src/worker/worker_transport.js";

// classes of browsers, which Node lacks
Object.assign(globalThis, {
  WebSocket: { CONNECTING: 0, OPEN: 1, CLOSED: 3 },
  CloseEvent: class extends Event {
    readonly code: number;
    constructor(type: string, { code }: { code: number }) {
      super(type);
      this.code = code;
    }
  },
});

/** A worker that records what it gets, and says what the test wants. */
class FakeWorker {
  readonly had: ToWorker[] = [];
  onmessage: ((event: { data: FromWorker }) => void) | null = null;
  postMessage(message: ToWorker): void {
    this.had.push(message);
    if (message.type === "openFiles") {
      this.say({ type: "progress", stage: "reading", share: 0.5 });
      this.say({ type: "opened", problem: message.own.files.length ? "" : "no file was given" });
    }
    if (message.type === "open") this.say({ type: "opened", problem: message.scene === "bad" ? "no such scene" : "" });
  }
  say(data: FromWorker): void {
    queueMicrotask(() => this.onmessage?.({ data }));
  }
}
const soon = () => new Promise((done) => setTimeout(done, 0));

async function opened(): Promise<{ worker: FakeWorker; transport: WorkerTransport }> {
  const worker = new FakeWorker();
  return { worker, transport: await WorkerTransport.open(worker as unknown as Worker, "knee") };
}

test("a scene that cannot be opened is an error with its reason", async () => {
  const worker = new FakeWorker();
  await assert.rejects(WorkerTransport.open(worker as unknown as Worker, "bad"), /no such scene/);
});

test("files of the user are opened with reports of progress", async () => {
  const worker = new FakeWorker();
  const stages: [string, number][] = [];
  const file = { name: "knee.nrrd" } as File;
  const own = { files: [file], contents: "labels" } as const;
  await WorkerTransport.open(worker as unknown as Worker, { ...own, files: [...own.files] }, (...stage) =>
    stages.push(stage),
  );
  assert.deepEqual(worker.had, [{ type: "openFiles", own }]);
  assert.deepEqual(stages, [["reading", 0.5]]);
  const none = WorkerTransport.open(worker as unknown as Worker, { files: [], contents: "values" });
  await assert.rejects(none, /no file was given/);
});

test("each request gets its own answer", async () => {
  const { worker, transport } = await opened();
  const [first, second] = [transport.get("/api/scene"), transport.get("/api/none")];
  const ids = worker.had.flatMap((message) => (message.type === "get" ? [message.id] : []));
  worker.say({ type: "answer", id: ids[1]!, status: 404, body: new ArrayBuffer(0) });
  worker.say({ type: "answer", id: ids[0]!, status: 200, body: new TextEncoder().encode("{}").buffer as ArrayBuffer });
  assert.equal((await second).status, 404);
  assert.deepEqual(await (await first).json(), {});
});

test("a socket opens, passes messages both ways, and closes", async () => {
  const { worker, transport } = await opened();
  const socket = transport.open();
  const had: unknown[] = [];
  socket.onopen = () => socket.send("hello");
  socket.onmessage = ({ data }) => had.push(data);
  socket.onclose = ({ code }) => had.push(code);
  await soon();
  assert.deepEqual(worker.had.slice(1), [
    { type: "connect", socket: 1 },
    { type: "send", socket: 1, text: "hello" },
  ]);
  worker.say({ type: "received", socket: 1, data: "welcome" });
  worker.say({ type: "closed", socket: 1, code: 4406 });
  worker.say({ type: "received", socket: 1, data: "too late" });
  await soon();
  assert.deepEqual(had, ["welcome", 4406]);
  assert.equal(socket.readyState, WebSocket.CLOSED);
});

test("messages of an earlier connection do not reach the present one", async () => {
  const { worker, transport } = await opened();
  transport.open().close();
  const socket = transport.open();
  const had: unknown[] = [];
  socket.onmessage = ({ data }) => had.push(data);
  await soon();
  worker.say({ type: "received", socket: 1, data: "old" });
  worker.say({ type: "received", socket: 2, data: "new" });
  await soon();
  assert.deepEqual(had, ["new"]);
});

test("a worker that dies fails what is pending, and every later request and connection", async () => {
  const { worker, transport } = await opened();
  const pending = transport.get("/api/scene");
  worker.say({ type: "died", why: "out of memory" });
  await assert.rejects(pending, /out of memory/);
  await assert.rejects(transport.get("/api/scene"), /out of memory/);
  const codes: number[] = [];
  transport.open().onclose = ({ code }) => codes.push(code);
  await soon();
  assert.deepEqual(codes, [1006]);
});
