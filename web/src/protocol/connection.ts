// WebSocket connection: reconnects with exponential backoff and tracks the age of the latest pose.

import { batch, signal } from "@preact/signals-core";
import type {
  Refusal,
  Request,
  Permission,
  Role,
  State,
  Plan,
  Tracked,
  Sweep,
  Debriefing,
  TaskProgress,
} from "./messages.js";
import { decodeDistances, isDistanceMessage, type DeviceDistances } from "./distances.js";
import { decodeDeformation, isDeformation, type DeformationMessage } from "./deformation_message.js";
import { decodePose, PROTOCOL, WireVersion, type Pose } from "./wire.js";
import { transport, type Socket } from "./transport.js";
import { words } from "../words/words.js";

/** State of the connection; "ended", and "over" after a lesson: no attempts until open() is called. */
export type Link = "connecting" | "connected" | "lost" | "refused" | "ended" | "over";

const FIRST_RETRY_MS = 250;
const MAX_RETRY_MS = 5000;
/** WebSocket close codes of palpate: docs/reference/viewer-protocol.md. */
const TOKEN_REFUSED = 4401,
  OTHER_PROTOCOL = 4406;
/** Close code of a connection that ended without a closing handshake (RFC 6455, 7.4.1). */
const ABNORMAL_CLOSURE = 1006;
/** Age beyond which a pose is displayed as stale. */
export const STALE_MS = 250;
/** Timeouts of a connection without messages, whose server may have vanished, and of one that is being established. */
const SILENT_MS = 6000,
  CONNECTING_MS = 20_000;
/**
 * Validity of an emergency stop that could not be sent: it is sent on reconnection within this time. Later, the
 * situation may have changed.
 */
const STOP_RETAINED_MS = 5000;

export interface Listener {
  onLink(link: Link): void;
  onState(state: State): void;
  onPose(pose: Pose): void;
  /** A token is required, or the one presented was rejected. */
  onToken(): void;
  onProblem(text: string): void;
  /** The server uses another version of the protocol. */
  onOtherProtocol(): void;
  /** At least two successive attempts to connect have failed. */
  onUnanswered(): void;
  /** A request awaits confirmation at the device; its response follows the confirmation. */
  onAsked(): void;
  /** Burr sweeps, which replace all from number `first` on. */
  onCut(first: number, sweeps: Sweep[]): void;
  /** Deformation of tissue around a device; reported in full on each connection. */
  onDeformation(received: DeformationMessage): void;
  /** Distances of each tool, sent before the first pose that they apply to; reported again on each connection. */
  onNear(near: DeviceDistances[]): void;
  /** The plan; reported again on each connection. */
  onPlan(plan: Plan): void;
  /** Registration error of a tracked tool; reported again on each connection. */
  onTracked(tracked: Tracked): void;
  /** Progress of a run of a task. */
  onTask(run: TaskProgress): void;
  /** Results of a finished run. */
  onDebriefing(debriefing: Debriefing): void;
}

export class Connection {
  readonly link = signal<Link>("ended");
  readonly role = signal<Role>("view");
  readonly learner = signal<string | null>(null); // pseudonym of this viewer; null: none
  private readonly may = signal<ReadonlySet<Permission>>(new Set());
  /** Time of arrival of the latest pose, by performance.now(). */
  poseAt_ms = -Infinity;
  readonly roundTrip_ms = signal(NaN); // round-trip time of the latest request
  private socket: Socket | null = null;
  private retry_ms = FIRST_RETRY_MS;
  private unanswered = 0; // number of attempts since the last welcome message
  private timer = 0;
  private nextId = 1;
  private heard_ms = 0;
  private isOver = false; // a teacher has ended the session of the current connection
  private unsentStop_ms = -Infinity; // time of the latest unacknowledged stop
  private readonly waiting = new Map<
    number,
    { type: Request["type"]; sent_ms: number; done(refusal: Refusal | null): void }
  >();

  constructor(
    private readonly listener: Listener,
    private token: string | null,
  ) {}

  open(): void {
    clearTimeout(this.timer);
    const socket = transport().open();
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard_ms = performance.now();
    this.isOver = false;
    if (this.link.peek() !== "connecting") this.setLink("connecting");
    socket.onopen = () => {
      const hello = {
        type: "hello",
        protocol: PROTOCOL,
        poses_hz: 60,
        yielded: true,
        task: true,
        near: true,
        plan: true,
        navigation: true,
      };
      socket.send(JSON.stringify(this.token ? { ...hello, token: this.token } : hello));
    };
    socket.onmessage = (event) => this.receive(socket, event.data as string | ArrayBuffer);
    socket.onclose = (event) => this.closed(socket, event.code);
  }

  setToken(token: string | null): void {
    this.token = token;
  }

  /** Whether this viewer is connected and has a permission. */
  allows(permission: Permission): boolean {
    return this.link.value === "connected" && this.may.value.has(permission);
  }
  /** Age of the latest pose. */
  age_ms(): number {
    return performance.now() - this.poseAt_ms;
  }
  isFresh(): boolean {
    return this.link.peek() === "connected" && this.age_ms() <= STALE_MS;
  }

  /**
   * Sends a request. A stop without a response is sent again on the next connection, within STOP_RETAINED_MS.
   * @returns null on success
   */
  request(request: Request): Promise<Refusal | null> {
    return new Promise((done) => {
      // a closing socket accepts messages but does not send them
      if (this.link.peek() !== "connected" || this.socket!.readyState > WebSocket.OPEN) {
        if (request.type !== "stop") return done({ what: words.notConnected, how: words.waitForIt });
        return done(this.retainStop(performance.now()));
      }
      const id = this.nextId++;
      this.waiting.set(id, { type: request.type, sent_ms: performance.now(), done });
      this.socket!.send(JSON.stringify({ ...request, id }));
    });
  }
  /**
   * Sends the pointer's position; dropped without a connection.
   * @param into  unit direction to press in from there, patient frame; absent: no press
   */
  moveTip(patient_mm: number[], into?: number[], force_N?: number): void {
    if (this.link.peek() === "connected")
      this.socket!.send(JSON.stringify({ type: "tip", patient_mm, ...(into && { into, force_N }) }));
  }
  /** Sets the pointer's tip down at a position, without a path to it: its contact is reset. */
  setTipDown(patient_mm: number[]): void {
    if (this.link.peek() === "connected")
      this.socket!.send(JSON.stringify({ type: "tip", patient_mm, set_down: true }));
  }
  /** Releases the pointer's tip; dropped without a connection, whose end releases it, too. */
  liftTip(): void {
    if (this.link.peek() === "connected") this.socket!.send(JSON.stringify({ type: "lift" }));
  }

  private retainStop(asked_ms: number): Refusal {
    this.unsentStop_ms = Math.max(this.unsentStop_ms, asked_ms);
    return { what: words.stopIsRetained, how: words.stopThere };
  }

  /** Closes a connection after its timeout; to be called periodically. */
  watch(): void {
    const { socket } = this;
    const link = this.link.peek();
    const max_ms = link === "connected" ? SILENT_MS : link === "connecting" ? CONNECTING_MS : Infinity;
    if (!socket || performance.now() - this.heard_ms <= max_ms) return;
    socket.close();
    // browsers report a vanished peer only after the timeout of the closing handshake
    this.closed(socket, ABNORMAL_CLOSURE);
  }

  /** Closes the connection, without reconnecting until open() is called. */
  end(): void {
    clearTimeout(this.timer);
    const socket = this.socket;
    this.socket = null;
    socket?.close();
    this.forgetWaiting();
    this.setLink("ended");
  }
  private otherProtocol(): void {
    this.end();
    this.listener.onOtherProtocol();
  }
  private forgetWaiting(): void {
    for (const { type, sent_ms, done } of this.waiting.values())
      done(type === "stop" ? this.retainStop(sent_ms) : { what: words.lostBeforeAnswer });
    this.waiting.clear();
  }

  private setLink(link: Link): void {
    this.link.value = link;
    this.listener.onLink(link);
  }

  private receive(socket: Socket, data: string | ArrayBuffer): void {
    if (socket !== this.socket) return;
    this.heard_ms = performance.now();
    if (typeof data !== "string") {
      try {
        if (isDistanceMessage(data)) return this.listener.onNear(decodeDistances(data));
        if (isDeformation(data)) return this.listener.onDeformation(decodeDeformation(data));
        const pose = decodePose(data);
        this.poseAt_ms = this.heard_ms;
        // a reset on welcome would retry a server with undecodable poses four times a second
        this.retry_ms = FIRST_RETRY_MS;
        this.listener.onPose(pose);
      } catch (error) {
        if (error instanceof WireVersion) return this.otherProtocol();
        this.listener.onProblem((error as Error).message);
        socket.close();
      }
      return;
    }
    const message = JSON.parse(data);
    switch (message.type) {
      case "welcome":
        this.unanswered = 0;
        batch(() => {
          this.role.value = message.role;
          this.learner.value = message.learner;
          this.may.value = new Set(message.may as Permission[]);
          this.setLink("connected");
        });
        if (performance.now() - this.unsentStop_ms <= STOP_RETAINED_MS) void this.request({ type: "stop" });
        this.unsentStop_ms = -Infinity;
        break;
      case "state":
        this.isOver = (message as State).lesson.over;
        this.listener.onState(message as State);
        break;
      case "cut":
        this.listener.onCut(message.first as number, message.sweeps as Sweep[]);
        break;
      case "plan":
        this.listener.onPlan(message as Plan);
        break;
      case "navigation":
        this.listener.onTracked(message as Tracked);
        break;
      case "task":
        this.listener.onTask(message as TaskProgress);
        break;
      case "debriefing":
        this.listener.onDebriefing(message as Debriefing);
        break;
      case "asked":
        this.listener.onAsked();
        break;
      case "done":
      case "refused": {
        const pending = this.waiting.get(message.id);
        if (!pending) break;
        this.waiting.delete(message.id);
        this.roundTrip_ms.value = this.heard_ms - pending.sent_ms;
        pending.done(message.type === "done" ? null : (message as Refusal));
        break;
      }
    }
  }

  private closed(socket: Socket, code: number): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.forgetWaiting();
    if (code === OTHER_PROTOCOL) return this.otherProtocol();
    if (code === TOKEN_REFUSED) {
      this.setLink("refused");
      this.listener.onToken();
      return;
    }
    if (this.isOver) return this.setLink("over");
    this.setLink("lost");
    this.timer = window.setTimeout(() => this.open(), this.retry_ms * (0.8 + 0.4 * Math.random()));
    this.retry_ms = Math.min(2 * this.retry_ms, MAX_RETRY_MS);
    this.unanswered += 1;
    if (this.unanswered > 1) this.listener.onUnanswered();
  }
}
