// Trouble that does not heal by itself, so that trying again and again would be of no use.

import { words } from "./words.js";

/** What lasts until somebody has mended it: what is wrong, and how that is done. */
export class Lasting extends Error {
  constructor(what: string, readonly how: string) {
    super(what);
  }
}
/** A volume that is not there (any more): another one may be, which the scene says. */
export class Gone extends Error {}
/** Of the graphics or of the page. */
export class NoMemory extends Error {}

export const isMemoryShort = (error: unknown): boolean => error instanceof NoMemory || error instanceof RangeError;

/** Refusals that another time brings to an end. */
const PASSING = [408, 425, 429];

/** What an answer of HTTP that is no success means, 401 excepted. */
export function troubleOf(path: string, status: number): Error {
  if (status < 400 || status >= 500 || PASSING.includes(status)) return new Error(words.answered(path, String(status)));
  if (status === 404 && path.startsWith("/api/volume/")) return new Gone(words.notThere(path));
  const how: Record<number, string> = { 403: words.mend403, 404: words.mend404, 421: words.mend421 };
  return new Lasting(words.refuses(path, String(status)), how[status] ?? words.mendOther);
}

/** @param theirs  null: not known */
export function versionTrouble(own: number, theirs: { version: number; palpate: string } | null): Lasting {
  const what = theirs ? words.otherVersion(theirs.palpate, String(theirs.version), String(own)) : words.someOtherVersion(String(own));
  return new Lasting(what, words.mendVersion);
}
