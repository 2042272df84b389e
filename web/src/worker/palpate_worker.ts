// Entry point of the worker that runs palpate.wasm: a session, with this page as its viewer
// (src/bindings/wasm/worker.cc).

import type { FromWorker, ToWorker } from "./messages.js";
import { wasi } from "./wasi.js";

interface Palpate {
  memory: WebAssembly.Memory;
  _initialize(): void;
  malloc(bytes: number): number;
  free(at: number): void;
  palpate_open(text: number, length: number): number;
  palpate_problem(): number;
  palpate_get(text: number, length: number): number;
  palpate_body(): number;
  palpate_body_size(): number;
  palpate_connect(): void;
  palpate_disconnect(): void;
  palpate_receive(text: number, length: number): void;
  palpate_step(): number; // whether there is more to do at once
}

/** Time between two steps, each of which runs the ticks of that time. */
const WAKE_MS = 2;

const page = self as unknown as {
  postMessage(message: FromWorker, transfer: Transferable[]): void;
  onmessage: ((event: MessageEvent<ToWorker>) => void) | null;
};
const say = (message: FromWorker, transfer: Transferable[] = []) => page.postMessage(message, transfer);

/**
 * Makes the next step, after the messages that have arrived. Timers that set timers are delayed to 4 ms (HTML, 8.7);
 * one that is set by a message is not.
 */
const next = new MessageChannel();

let palpate!: Palpate;
let socket = 0; // number of the page's connection
let lastText = ""; // last text on stderr, which explains a trap

const copy = (at: number, length: number): ArrayBuffer => palpate.memory.buffer.slice(at, at + length) as ArrayBuffer;
const textAt = (at: number): string => {
  const bytes = new Uint8Array(palpate.memory.buffer);
  return new TextDecoder().decode(bytes.slice(at, bytes.indexOf(0, at)));
};

function withText<T>(text: string, call: (at: number, length: number) => T): T {
  const bytes = new TextEncoder().encode(text);
  const at = palpate.malloc(bytes.length);
  new Uint8Array(palpate.memory.buffer).set(bytes, at);
  try {
    return call(at, bytes.length);
  } finally {
    palpate.free(at);
  }
}

async function load(): Promise<void> {
  const imports = {
    wasi_snapshot_preview1: wasi(
      () => palpate.memory,
      (text) => (lastText = text.trim()),
    ),
    palpate: {
      send: (at: number, length: number, isBinary: number) => {
        const data = copy(at, length);
        if (isBinary) say({ type: "received", socket, data }, [data]);
        else say({ type: "received", socket, data: new TextDecoder().decode(data) });
      },
      close: (code: number) => say({ type: "closed", socket, code }),
    },
  };
  const fetched = fetch(new URL("./palpate.wasm", self.location.href));
  // a static server may not know the type of .wasm, which instantiateStreaming() insists on
  const { instance } = await WebAssembly.instantiate(await (await fetched).arrayBuffer(), imports);
  palpate = instance.exports as unknown as Palpate;
  palpate._initialize();
}

function step(): void {
  alive(() => {
    const goOn = () => next.port2.postMessage(null);
    if (palpate.palpate_step()) goOn();
    else setTimeout(goOn, WAKE_MS);
  });
}
next.port1.onmessage = step;

/** Runs a call into palpate; a trap ends the session. */
function alive(call: () => void): void {
  try {
    call();
  } catch (error) {
    page.onmessage = null;
    say({ type: "died", why: lastText || (error as Error).message });
  }
}

function handle(message: ToWorker): void {
  switch (message.type) {
    case "open": {
      const isOpen = withText(message.scene, (at, length) => palpate.palpate_open(at, length));
      say({ type: "opened", problem: isOpen ? "" : textAt(palpate.palpate_problem()) });
      if (isOpen) step();
      break;
    }
    case "get": {
      const status = withText(message.path, (at, length) => palpate.palpate_get(at, length));
      const body = copy(palpate.palpate_body(), palpate.palpate_body_size());
      say({ type: "answer", id: message.id, status, body }, [body]);
      break;
    }
    case "connect":
      socket = message.socket;
      palpate.palpate_connect();
      break;
    case "send":
      if (message.socket === socket) withText(message.text, (at, length) => palpate.palpate_receive(at, length));
      break;
    case "disconnect":
      if (message.socket === socket) palpate.palpate_disconnect();
      break;
  }
}

const loaded = load();
page.onmessage = async ({ data }) => {
  try {
    await loaded;
  } catch (error) {
    return say({ type: "died", why: (error as Error).message });
  }
  alive(() => handle(data));
};
