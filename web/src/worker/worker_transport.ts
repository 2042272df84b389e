// The page's transport to a worker of its own, in place of a server.

import type { Socket, Transport } from "../protocol/transport.js";
import type { FromWorker, OwnFiles, ToWorker } from "./messages.js";

/** Close code of a connection that ended without a closing handshake (RFC 6455, 7.4.1). */
const ABNORMAL_CLOSURE = 1006;

/** A worker with a session. */
export class WorkerTransport implements Transport {
  private readonly answers = new Map<number, { done(response: Response): void; failed(error: Error): void }>();
  private nextId = 1;
  private sockets = 0;
  private socket: WorkerSocket | null = null;
  private died: Error | null = null;
  private opened!: { done(): void; failed(error: Error): void };

  private constructor(
    private readonly worker: Worker,
    private readonly onProgress: (stage: string, share: number) => void,
  ) {
    worker.onmessage = ({ data }: MessageEvent<FromWorker>) => this.handle(data);
    worker.onerror = (event) => this.end(new Error(event.message));
  }

  /**
   * Starts a session on a scene by its name, or on files of the user.
   * @param onProgress  called while it is opened, with the stage and the part of it that is done
   * @throws Error with the reason if it cannot be opened
   */
  static async open(
    worker: Worker,
    scene: string | OwnFiles,
    onProgress: (stage: string, share: number) => void = () => {},
  ): Promise<WorkerTransport> {
    const transport = new WorkerTransport(worker, onProgress);
    const isOpen = new Promise<void>((done, failed) => (transport.opened = { done, failed }));
    transport.say(typeof scene === "string" ? { type: "open", scene } : { type: "openFiles", own: scene });
    await isOpen;
    return transport;
  }

  get(path: string): Promise<Response> {
    return new Promise((done, failed) => {
      if (this.died) return failed(this.died);
      const id = this.nextId++;
      this.answers.set(id, { done, failed });
      this.say({ type: "get", id, path });
    });
  }

  open(): Socket {
    const number = ++this.sockets;
    const socket = new WorkerSocket(
      (text) => this.say({ type: "send", socket: number, text }),
      () => this.say({ type: "disconnect", socket: number }),
    );
    this.socket = socket;
    if (this.died) queueMicrotask(() => socket.end(ABNORMAL_CLOSURE));
    else {
      this.say({ type: "connect", socket: number });
      queueMicrotask(() => socket.begin());
    }
    return socket;
  }

  private say(message: ToWorker): void {
    this.worker.postMessage(message);
  }

  private handle(message: FromWorker): void {
    switch (message.type) {
      case "progress":
        this.onProgress(message.stage, message.share);
        break;
      case "opened":
        if (message.problem) this.opened.failed(new Error(message.problem));
        else this.opened.done();
        break;
      case "answer":
        this.answers.get(message.id)?.done(new Response(message.body, { status: message.status }));
        this.answers.delete(message.id);
        break;
      case "received":
        if (message.socket === this.sockets) this.socket?.receive(message.data);
        break;
      case "closed":
        if (message.socket === this.sockets) this.socket?.end(message.code);
        break;
      case "died":
        this.end(new Error(message.why));
        break;
    }
  }

  private end(why: Error): void {
    this.died = why;
    this.opened.failed(why);
    for (const { failed } of this.answers.values()) failed(why);
    this.answers.clear();
    this.socket?.end(ABNORMAL_CLOSURE);
  }
}

class WorkerSocket implements Socket {
  binaryType = "arraybuffer";
  readyState = 0; // WebSocket.CONNECTING
  onopen: Socket["onopen"] = null;
  onmessage: Socket["onmessage"] = null;
  onclose: Socket["onclose"] = null;

  constructor(
    private readonly sent: (text: string) => void,
    private readonly closed: () => void,
  ) {}

  begin(): void {
    this.readyState = WebSocket.OPEN;
    this.onopen?.(new Event("open"));
  }
  receive(data: string | ArrayBuffer): void {
    if (this.readyState === WebSocket.OPEN) this.onmessage?.(new MessageEvent("message", { data }));
  }
  end(code: number): void {
    if (this.readyState === WebSocket.CLOSED) return;
    this.readyState = WebSocket.CLOSED;
    this.onclose?.(new CloseEvent("close", { code }));
  }
  send(text: string): void {
    if (this.readyState === WebSocket.OPEN) this.sent(text);
  }
  close(): void {
    if (this.readyState === WebSocket.CLOSED) return;
    this.closed();
    this.end(1000);
  }
}
