// Requests to the loop. While a request of a slider is pending, only its latest value is queued. If requests need a
// confirmation at the device, only the value at which the slider comes to rest is sent.

import { signal } from "@preact/signals-core";
import { toast } from "../base/announce.js";
import type { Refusal, Request, State } from "../protocol/messages.js";
import { SETTING_NAMES } from "../protocol/protocol.gen.js";
import type { Connection } from "../protocol/connection.js";
import { angleOf_deg, conjugate, multiply, normalizeQuaternion, type Quaternion } from "../base/geometry.js";
import type { History } from "./history.js";
import { capitalized, words } from "../words/words.js";

const AT_REST_MS = 500;
/** Settings that are switched back and forth during a session, and therefore not undone. */
const NOT_UNDOABLE: readonly string[] = ["paused", "motor"];
const isUndoable = (name: string): boolean =>
  name === "law" || ((SETTING_NAMES as readonly string[]).includes(name) && !NOT_UNDOABLE.includes(name));

type Values = Record<string, unknown>;
/** Current values of the settings that a request changes; null for other requests. */
function holding(request: Request, state: State): Values | null {
  const { type, tissue, ...asked } = request as Request & { tissue?: number };
  const of: Values | undefined =
    type === "tissue"
      ? { ...state.tissues[tissue!] }
      : { ...state, method: state.method_awaited ?? state.method, law: state.law_awaited ?? state.law };
  const names = Object.keys(asked);
  if (names.length === 0 || (type !== "tissue" && (type !== "set" || !names.every(isUndoable)))) return null;
  return Object.fromEntries(names.map((name) => [name, of[name]]));
}
const SAME_TURN_DEG = 0.01;
/** Whether values agree within rounding by the loop; q and -q are the same rotation. */
const isSame = (a: unknown, b: unknown): boolean => {
  if (Array.isArray(a) && Array.isArray(b))
    return (
      angleOf_deg(multiply(normalizeQuaternion(a as Quaternion), conjugate(normalizeQuaternion(b as Quaternion)))) <
      SAME_TURN_DEG
    );
  return typeof a === "number" && typeof b === "number"
    ? Math.abs(a - b) <= 1e-5 * Math.max(Math.abs(a), Math.abs(b))
    : a === b;
};
const areSame = (a: Values, b: Values): boolean => Object.keys(a).every((name) => isSame(a[name], b[name]));

export class Requests {
  private readonly resting = new Map<string, number>();
  private readonly busy = new Set<string>();
  private readonly next = new Map<string, [Request, number]>();
  /** Number of refused requests, after each of which controls are reset to the current values. */
  readonly refusals = signal(0);

  /** @param isAsked  whether requests need a confirmation at the device */
  constructor(
    private readonly connection: Connection,
    private readonly isAsked: () => boolean,
    private readonly state: () => State | null,
    private readonly history: History,
  ) {}

  /**
   * Sends a request; one at a time is pending for each key.
   * @param key  a newer request with this key replaces a queued one
   * @param gesture  requests with equal gesture are one undo step
   */
  async latest(key: string, request: Request, gesture = this.history.gesture): Promise<void> {
    clearTimeout(this.resting.get(key));
    if (this.isAsked()) {
      this.resting.set(
        key,
        window.setTimeout(() => void this.once(request, gesture), AT_REST_MS),
      );
      return;
    }
    if (this.busy.has(key)) {
      this.next.set(key, [request, gesture]);
      return;
    }
    this.busy.add(key);
    await this.once(request, gesture);
    this.busy.delete(key);
    const waiting = this.next.get(key);
    this.next.delete(key);
    if (waiting) await this.latest(key, ...waiting);
  }

  async once(request: Request, gesture = ++this.history.gesture): Promise<boolean> {
    const state = this.state();
    const before = state && holding(request, state);
    const isGranted = await this.ask(request);
    if (isGranted && before && !areSame(before, request)) {
      const { type, tissue } = request;
      const key = JSON.stringify([type, tissue, Object.keys(before)]);
      this.history.push(
        key,
        { before: { ...request, ...before }, after: request, apply: (from, to) => this.replace(from, to) },
        gesture,
      );
    }
    return isGranted;
  }

  private async ask(request: Request): Promise<boolean> {
    const refusal = await this.connection.request(request);
    if (refusal) {
      toast(refusalText(refusal));
      this.refusals.value += 1;
    }
    return refusal === null;
  }
  /** Requests `target` if the values are still those of `current`; otherwise another viewer has changed them. */
  private async replace(current: Request, target: Request): Promise<boolean> {
    const state = this.state();
    if (state && areSame(holding(current, state)!, current)) return this.ask(target);
    toast(words.changedSince);
    return false;
  }
}

const sentence = (text: string): string => capitalized(text) + (/[.!?]$/.test(text) ? "" : ".");
export const refusalText = ({ what, how }: Refusal): string =>
  how ? `${sentence(what)} ${sentence(how)}` : sentence(what);
