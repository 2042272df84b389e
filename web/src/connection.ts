// The WebSocket: it comes back by itself, keeps the latest pose, and knows how old that is.

import type { Sweep } from "./cuts.js";
import { decodeNear, isNear, type Near } from "./near.js";
import type { Plan } from "./plan.js";
import type { State } from "./scene.js";
import type { Tracked } from "./tracked.js";
import type { Debriefing, TaskRun } from "./training.js";
import { decodeYield, isYield, type Yield } from "./yields.js";
import { decodePose, PROTOCOL, WireVersion, type Pose } from "./wire.js";
import { words } from "./words.js";

/** "ended": it is not tried, or not again, before open() is called. */
export type Link = "connecting" | "connected" | "lost" | "refused" | "ended";
export type Role = "view" | "control" | "learner" | "teacher";
/** What a viewer may do, as palpate says it (docs/reference/viewer-protocol.md). */
export type Right = "look" | "stop" | "unseen" | "hand" | "feel" | "plan" | "play" | "lesson" | "own_runs" | "all_runs";
export interface Refusal { what: string; where?: string; how?: string }
export interface Request { type: "set" | "tissue" | "stop" | "rearm" | "pointer" | "play" | "undo" | "redo" | "task" | "plan" | "lesson"; [value: string]: unknown }

const FIRST_RETRY_MS = 250;
const LONGEST_RETRY_MS = 5000;
/** palpate's close codes, docs/reference/viewer-protocol.md. */
const TOKEN_REFUSED = 4401, OTHER_PROTOCOL = 4406;
/** As a browser closes what ended without a word. */
const GONE = 1006;
/** Data older than this is grey. */
export const STALE_MS = 250;
/** A connection that says nothing for this long is given up: its other end may be gone without a word. So is one that does not come about. */
const SILENT_MS = 6000, CONNECTING_MS = 20_000;
/** A stop that could not be sent is sent late where that is at most so late: whoever pressed it has not gone on to something else. */
const STOP_KEPT_MS = 5000;

export interface Listener {
  onLink(link: Link): void;
  onState(state: State): void;
  onPose(pose: Pose): void;
  /** A token is needed, or the one that was shown is wrong. */
  onToken(): void;
  onProblem(text: string): void;
  /** The other end speaks another version of the protocol. */
  onOtherProtocol(): void;
  /** It could not be connected, more than once. */
  onUnanswered(): void;
  /** Somebody at the device is asked whether a request may be; its answer comes when they have said so. */
  onAsked(): void;
  /** What was cut away: what was told before from number `first` on is not any more, and this comes after the rest. */
  onCut(first: number, sweeps: Sweep[]): void;
  /** How tissue around a device has yielded; on another connection all is told anew. */
  onYield(told: Yield): void;
  /** What is near each tool, right before the pose from which on it holds; on another connection it is told anew. */
  onNear(near: Near[]): void;
  /** The plan that is rehearsed; on another connection it is told anew. */
  onPlan(plan: Plan): void;
  /** How wrong a tracked tip's place may be; on another connection it is told anew. */
  onTracked(tracked: Tracked): void;
  /** How far a run of a task is. */
  onTask(run: TaskRun): void;
  /** One that is over. */
  onDebriefing(debriefing: Debriefing): void;
}

export class Connection {
  link: Link = "ended";
  role: Role = "view";
  learner: string | null = null; // one's own pseudonym
  private may: ReadonlySet<Right> = new Set();
  pose: Pose | null = null;
  /** performance.now() when the latest pose came */
  poseAt_ms = -Infinity;
  roundTrip_ms = NaN; // of the latest request
  private socket: WebSocket | null = null;
  private retry_ms = FIRST_RETRY_MS;
  private unanswered = 0; // attempts since the last welcome
  private timer = 0;
  private nextId = 1;
  private heard_ms = 0;
  private unsentStop_ms = -Infinity; // when it was asked for, by whatever nobody has answered
  private readonly waiting = new Map<number, { type: Request["type"]; sent_ms: number; done(refusal: Refusal | null): void }>();

  constructor(private readonly listener: Listener, private token: string | null) {}

  open(): void {
    clearTimeout(this.timer);
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`, "palpate.v1");
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.heard_ms = performance.now();
    if (this.link !== "connecting") this.setLink("connecting");
    socket.onopen = () => {
      const hello = { type: "hello", protocol: PROTOCOL, poses_hz: 60, yielded: true, task: true, near: true, plan: true, navigation: true };
      socket.send(JSON.stringify(this.token ? { ...hello, token: this.token } : hello));
    };
    socket.onmessage = (event) => this.receive(socket, event.data as string | ArrayBuffer);
    socket.onclose = (event) => this.closed(socket, event.code);
  }

  setToken(token: string | null): void {
    this.token = token;
  }

  /** Whether this viewer may do something now. */
  allows(right: Right): boolean {
    return this.link === "connected" && this.may.has(right);
  }
  /** Of the latest pose. */
  age_ms(): number {
    return performance.now() - this.poseAt_ms;
  }
  isFresh(): boolean {
    return this.link === "connected" && this.age_ms() <= STALE_MS;
  }

  /** Resolves to null when it was done. A stop is kept for a connection that comes soon, also one whose answer does not come. */
  ask(request: Request): Promise<Refusal | null> {
    return new Promise((done) => {
      // one that is being closed takes everything and sends nothing
      if (this.link !== "connected" || this.socket!.readyState > WebSocket.OPEN) {
        if (request.type !== "stop") return done({ what: words.notConnected, how: words.waitForIt });
        return done(this.keepStop(performance.now()));
      }
      const id = this.nextId++;
      this.waiting.set(id, { type: request.type, sent_ms: performance.now(), done });
      this.socket!.send(JSON.stringify({ ...request, id }));
    });
  }
  /** The pointer's position; lost when there is no connection. */
  moveTip(patient_mm: number[]): void {
    if (this.link === "connected") this.socket!.send(JSON.stringify({ type: "tip", patient_mm }));
  }

  private keepStop(asked_ms: number): Refusal {
    this.unsentStop_ms = Math.max(this.unsentStop_ms, asked_ms);
    return { what: words.stopIsKept, how: words.stopThere };
  }

  /** To be called now and then. */
  watch(): void {
    const { socket } = this;
    const max_ms = this.link === "connected" ? SILENT_MS : this.link === "connecting" ? CONNECTING_MS : Infinity;
    if (!socket || performance.now() - this.heard_ms <= max_ms) return;
    socket.close();
    // that the other end is gone the browser tells only when it has waited for its goodbye
    this.closed(socket, GONE);
  }

  /** Gives up, until open() is called. */
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
    for (const { type, sent_ms, done } of this.waiting.values()) done(type === "stop" ? this.keepStop(sent_ms) : { what: words.lostBeforeAnswer });
    this.waiting.clear();
  }

  private setLink(link: Link): void {
    this.link = link;
    this.listener.onLink(link);
  }

  private receive(socket: WebSocket, data: string | ArrayBuffer): void {
    if (socket !== this.socket) return;
    this.heard_ms = performance.now();
    if (typeof data !== "string") {
      try {
        if (isNear(data)) return this.listener.onNear(decodeNear(data));
        if (isYield(data)) return this.listener.onYield(decodeYield(data));
        const pose = decodePose(data);
        this.pose = pose;
        this.poseAt_ms = this.heard_ms;
        // only now: a server whose poses cannot be read is not asked for more of them four times a second
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
        this.role = message.role;
        this.learner = message.learner;
        this.may = new Set(message.may as Right[]);
        this.unanswered = 0;
        this.pose = null;
        this.setLink("connected");
        if (performance.now() - this.unsentStop_ms <= STOP_KEPT_MS) void this.ask({ type: "stop" });
        this.unsentStop_ms = -Infinity;
        break;
      case "state":
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
        this.listener.onTask(message as TaskRun);
        break;
      case "debriefing":
        this.listener.onDebriefing(message as Debriefing);
        break;
      case "asked":
        this.listener.onAsked();
        break;
      case "done":
      case "refused": {
        const asked = this.waiting.get(message.id);
        if (!asked) break;
        this.waiting.delete(message.id);
        this.roundTrip_ms = this.heard_ms - asked.sent_ms;
        asked.done(message.type === "done" ? null : (message as Refusal));
        break;
      }
    }
  }

  private closed(socket: WebSocket, code: number): void {
    if (socket !== this.socket) return;
    this.socket = null;
    this.forgetWaiting();
    if (code === OTHER_PROTOCOL) return this.otherProtocol();
    if (code === TOKEN_REFUSED) {
      this.setLink("refused");
      this.listener.onToken();
      return;
    }
    this.setLink("lost");
    this.timer = window.setTimeout(() => this.open(), this.retry_ms * (0.8 + 0.4 * Math.random()));
    this.retry_ms = Math.min(2 * this.retry_ms, LONGEST_RETRY_MS);
    this.unanswered += 1;
    if (this.unanswered > 1) this.listener.onUnanswered();
  }
}
