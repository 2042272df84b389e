// Page in Node, with jsdom as DOM, the mock as server, and a canvas that discards drawing: for tests of the page's
// behaviour, texts and requests. Appearance, layout, focus and real pointers are tested in a browser (tests/browser/).
// Modules of the page have state of the process, so that each test file opens one page.

import assert from "node:assert/strict";
import { fork, type ChildProcess } from "node:child_process";
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import { join } from "node:path";
import { after, describe } from "node:test";
import { JSDOM, VirtualConsole } from "jsdom";
// @ts-expect-error ws has no type declarations
import { WebSocket as Socket } from "ws";
import type { Vec3 } from "../src/base/geometry.js";

/** Timeout of waits, far above their duration even on a busy machine. */
const PATIENCE_MS = 120_000;

export class MockServer {
  private process: ChildProcess | null = null;
  port = 0;

  constructor(private options: string[]) {}
  get url(): string {
    return `http://127.0.0.1:${this.port}/`;
  }
  /** @param options  command line of the mock; default: that of the previous start */
  async start(options = this.options): Promise<void> {
    this.options = options;
    const child = fork("test/mock_server.mjs", ["--port", String(this.port), ...options], {
      execArgv: [],
      stdio: ["ignore", "pipe", "inherit", "ipc"],
    });
    this.process = child;
    this.port = await new Promise<number>((done, failed) => {
      child.stdout!.on("data", (text: Buffer) => done(Number(/:(\d+)\//.exec(String(text))![1])));
      child.on("exit", () => failed(new Error("the mock server has ended")));
    });
  }
  async stop(): Promise<void> {
    const child = this.process;
    this.process = null;
    if (!child || child.exitCode !== null) return;
    const ended = new Promise((done) => child.on("exit", done));
    child.kill("SIGCONT");
    child.kill("SIGKILL");
    await ended;
  }
  signal(name: "SIGSTOP" | "SIGCONT"): void {
    this.process!.kill(name);
  }
}

/** Canvas context for jsdom that discards drawing. */
function contextOf(canvas: HTMLCanvasElement): CanvasRenderingContext2D {
  const own: Record<string | symbol, unknown> = {
    canvas,
    measureText: (text: string) => ({ width: 6 * text.length }),
    createLinearGradient: () => ({ addColorStop: () => undefined }),
    createRadialGradient: () => ({ addColorStop: () => undefined }),
    getImageData: (_x: number, _y: number, width: number, height: number) => ({
      width,
      height,
      data: new Uint8ClampedArray(4 * width * height),
    }),
  };
  return new Proxy(own, {
    get: (its, name) => (name in its ? its[name] : () => undefined),
  }) as unknown as CanvasRenderingContext2D;
}

/** Worker that accepts the volume and returns no pictures. */
class IdleWorker {
  onmessage: ((event: { data: unknown }) => void) | null = null;
  onerror: (() => void) | null = null;
  private answer(data: unknown): void {
    setTimeout(() => this.onmessage?.({ data }));
  }
  constructor() {
    this.answer({ type: "ready", lockName: "" });
  }
  postMessage({ type }: { type: string }): void {
    if (type === "begin") this.answer({ type: "begun", fits: true });
    if (type === "put" || type === "displace" || type === "putDisplacement") this.answer({ type: "put" });
  }
  terminate(): void {}
}

/** Interface of src/test_hook.ts. */
// eslint-disable-next-line @typescript-eslint/no-explicit-any
type Hook = any;

export class TestPage {
  constructor(
    readonly server: MockServer,
    readonly close: () => Promise<void>,
  ) {}

  get viewer(): Hook {
    return (window as unknown as { palpateViewer?: Hook }).palpateViewer;
  }
  byId<E extends HTMLElement = HTMLInputElement>(id: string): E {
    return document.getElementById(id) as E;
  }
  text(id: string): string {
    return this.byId(id).textContent ?? "";
  }
  all<E extends HTMLElement = HTMLElement>(selector: string): E[] {
    return [...document.querySelectorAll<E>(selector)];
  }
  /** Elements without a hidden ancestor. */
  shown<E extends HTMLElement = HTMLElement>(selector: string): E[] {
    return this.all<E>(selector).filter((one) => one.closest("[hidden]") === null);
  }
  click(target: string | HTMLElement): void {
    (typeof target === "string" ? document.querySelector<HTMLElement>(target)! : target).click();
  }
  /** Sets the value of a control and dispatches an event, as for a user's input. */
  set(target: string | HTMLElement, value: string | number, type = "change"): void {
    const control =
      typeof target === "string" ? document.querySelector<HTMLInputElement>(target)! : (target as HTMLInputElement);
    control.value = String(value);
    control.dispatchEvent(new Event(type, { bubbles: true }));
  }
  key(key: string, options: KeyboardEventInit = {}, target: Element = document.body): void {
    target.dispatchEvent(new KeyboardEvent("keydown", { key, bubbles: true, cancelable: true, ...options }));
  }
  /**
   * Waits until a condition holds.
   * @param what  description of the condition, for the error on timeout
   */
  async wait(what: string, isTrue: () => unknown): Promise<void> {
    const until = Date.now() + PATIENCE_MS;
    while (!isTrue()) {
      if (Date.now() > until) throw new Error(`never became true: ${what}`);
      await new Promise((later) => setTimeout(later, 10));
    }
  }
  /**
   * Mean position of a structure's voxels, patient frame, mm.
   * @param structure  index of the structure
   */
  middleOf(structure: number): Vec3 {
    const {
      volume: { dims, patient_from_voxel: m },
    } = this.viewer.scene as { volume: { dims: Vec3; patient_from_voxel: number[][] } };
    const sum: Vec3 = [0, 0, 0];
    let count = 0;
    for (let k = 0; k < dims[2]; k++)
      for (let j = 0; j < dims[1]; j++)
        for (let i = 0; i < dims[0]; i++) {
          const p = m.slice(0, 3).map((row) => row[0]! * i + row[1]! * j + row[2]! * k + row[3]!) as Vec3;
          if (this.viewer.structureAt(p) !== structure) continue;
          p.forEach((x, axis) => (sum[axis]! += x));
          count += 1;
        }
    return sum.map((x) => x / count) as Vec3;
  }
  /** Resolves when all pending tasks that need no external response are complete. */
  settle(): Promise<void> {
    return new Promise((later) => setTimeout(later));
  }
  draw(): void {
    this.viewer.draw();
  }
  isLoaded(): boolean {
    return this.viewer?.isLoaded === true && this.viewer.isFresh === true && this.byId("cover").hidden;
  }
}

/**
 * Opens the page.
 * @param options  command line of the mock server
 * @param wanted  condition to wait for
 */
export async function openPage(
  options: string[],
  wanted: (page: TestPage) => boolean = (page) => page.isLoaded(),
): Promise<TestPage> {
  const server = new MockServer(["--scan", "ramp", ...options]);
  await server.start();
  const html = readFileSync("index.html", "utf8").replace(/<script.*?<\/script>|<link rel="stylesheet".*?>/g, "");
  const errors: string[] = [];
  const virtualConsole = new VirtualConsole().on("jsdomError", (error) =>
    errors.push(String((error as Error & { detail?: Error }).detail?.stack ?? error)),
  );
  const dom = new JSDOM(html, { url: server.url, pretendToBeVisual: true, virtualConsole });
  const { window: its } = dom;
  const names = [
    "window",
    "document",
    "location",
    "navigator",
    "localStorage",
    "sessionStorage",
    "Option",
    "Event",
    "KeyboardEvent",
    "MouseEvent",
    "WheelEvent",
    "HTMLElement",
    "Node",
    "DOMParser",
    "requestAnimationFrame",
    "addEventListener",
    "removeEventListener",
    "dispatchEvent",
  ] as const;
  for (const name of names) {
    const value = (its as unknown as Record<string, unknown>)[name];
    const isMethod = typeof value === "function" && /^[a-z]/.test(name);
    Object.defineProperty(globalThis, name, {
      value: isMethod ? (value as () => void).bind(its) : value,
      configurable: true,
      writable: true,
    });
  }
  Object.defineProperty(its.navigator, "webdriver", { value: true });
  Object.defineProperty(its.navigator, "languages", { value: ["en"] });
  its.HTMLCanvasElement.prototype.getContext = function (this: HTMLCanvasElement, kind: string) {
    return kind === "2d" ? contextOf(this) : null;
  } as never;
  // jsdom has no modal dialogs
  its.HTMLDialogElement.prototype.showModal = function (this: HTMLDialogElement) {
    this.open = true;
  };
  for (const [side, pixels] of [
    ["clientWidth", 64],
    ["clientHeight", 48],
  ] as const)
    Object.defineProperty(its.Element.prototype, side, { get: () => pixels });
  const fetchFromAnywhere = globalThis.fetch;
  // open channels, which would keep the process alive, are closed with the page
  const channels: MessageChannel[] = [];
  const stubs = {
    Worker: IdleWorker,
    ResizeObserver: class {
      constructor(private readonly measured: () => void) {}
      observe(): void {
        this.measured();
      }
    },
    ImageData: class {
      readonly data: Uint8ClampedArray;
      constructor(
        readonly width: number,
        readonly height: number,
      ) {
        this.data = new Uint8ClampedArray(4 * width * height);
      }
    },
    Path2D: class {},
    MessageChannel: class extends MessageChannel {
      constructor() {
        super();
        channels.push(this);
      }
    },
    // an unhandled error event would end the process; the page handles the close event that follows
    WebSocket: class extends Socket {
      constructor(...all: ConstructorParameters<typeof Socket>) {
        super(...all);
        (this as unknown as EventTarget).addEventListener("error", () => {});
      }
    },
    matchMedia: () => ({ matches: true, addEventListener() {} }),
    getComputedStyle: () => ({ getPropertyValue: () => "#808080" }),
    fetch: (path: string, more?: RequestInit) => fetchFromAnywhere(new URL(path, server.url), more),
  };
  Object.assign(globalThis, stubs);
  // numeric handles of timers, because the page mixes window.setTimeout and clearTimeout; Node accepts numbers, too
  const timers: NodeJS.Timeout[] = [];
  const begun = (timer: NodeJS.Timeout): number => Number(timers[timers.push(timer) - 1]);
  Object.assign(its, {
    matchMedia: stubs.matchMedia,
    devicePixelRatio: 1,
    clearTimeout,
    clearInterval,
    setTimeout: (...all: Parameters<typeof setTimeout>) => begun(setTimeout(...all)),
    setInterval: (...all: Parameters<typeof setInterval>) => begun(setInterval(...all)),
  });

  const close = async () => {
    its.dispatchEvent(new its.Event("pagehide"));
    its.close();
    timers.forEach(clearTimeout);
    channels.forEach(({ port1 }) => port1.close());
    await server.stop();
    for (const error of errors) console.error(error);
    assert.equal(errors.length, 0, "the page has thrown something");
  };
  const page = new TestPage(server, close);
  try {
    await import("../src/main.js");
    await page.wait("the page is loaded", () => page.viewer && wanted(page));
  } catch (error) {
    console.error(error); // before the page reacts to being closed
    await close();
    throw error;
  }
  return page;
}

/** Runs the tests of a page, then closes page and server, which would keep the process alive. */
export function testsOf(page: TestPage, name: string, tests: () => void): void {
  describe(name, () => {
    after(page.close);
    tests();
  });
}

/** Path of a temporary file of tokens, one per line, deleted after the tests. */
export function tokenFile(lines: string): string {
  const folder = mkdtempSync(join(tmpdir(), "palpate-tokens-"));
  process.on("exit", () => rmSync(folder, { recursive: true }));
  writeFileSync(join(folder, "tokens"), lines);
  return join(folder, "tokens");
}
