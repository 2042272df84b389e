// Requests to the loop. Of a slider's many values only the latest goes out while one is on its way. While a device may push each of them is
// a question to somebody there: then the one at which the slider comes to rest.

import type { Connection, Refusal, Request } from "./connection.js";
import { toast } from "./dom.js";

const AT_REST_MS = 500;

export class Requests {
  private readonly resting = new Map<string, number>();
  private readonly busy = new Set<string>();
  private readonly next = new Map<string, Request>();
  /** Called after every refusal: what is shown goes back to what holds. */
  onRefused: () => void = () => {};

  /** @param isAsked  whether somebody is asked before anything changes */
  constructor(private readonly connection: Connection, private readonly isAsked: () => boolean) {}

  /** @param key  requests of one key replace each other */
  async latest(key: string, request: Request): Promise<void> {
    clearTimeout(this.resting.get(key));
    if (this.isAsked()) {
      this.resting.set(key, window.setTimeout(() => void this.once(request), AT_REST_MS));
      return;
    }
    if (this.busy.has(key)) {
      this.next.set(key, request);
      return;
    }
    this.busy.add(key);
    await this.once(request);
    this.busy.delete(key);
    const waiting = this.next.get(key);
    this.next.delete(key);
    if (waiting) await this.latest(key, waiting);
  }

  async once(request: Request): Promise<boolean> {
    const refusal = await this.connection.ask(request);
    if (refusal) {
      toast(refusalText(refusal));
      this.onRefused();
    }
    return refusal === null;
  }
}

const sentence = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1) + (/[.!?]$/.test(text) ? "" : ".");
export const refusalText = ({ what, how }: Refusal): string => (how ? `${sentence(what)} ${sentence(how)}` : sentence(what));
