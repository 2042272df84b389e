// Errors by the reaction that they require; permanent ones explain their remedy.

import { words } from "./words.js";

/** Permanent error, which retrying does not solve: cause and remedy. */
export class Lasting extends Error {
  constructor(
    what: string,
    readonly how: string,
  ) {
    super(what);
  }
}
/** A volume that does not exist (any more): the scene may refer to another one. */
export class Gone extends Error {}
/** Insufficient memory, of the graphics or of the page. */
export class NoMemory extends Error {}

export const isMemoryShort = (error: unknown): boolean => error instanceof NoMemory || error instanceof RangeError;

/** HTTP status codes of temporary refusals. */
const PASSING = [408, 425, 429];

/** Error for an unsuccessful HTTP status other than 401. */
export function troubleOf(path: string, status: number): Error {
  if (status < 400 || status >= 500 || PASSING.includes(status)) return new Error(words.answered(path, String(status)));
  if (status === 404 && path.startsWith("/api/volume/")) return new Gone(words.notThere(path));
  const how: Record<number, string> = { 403: words.mend403, 404: words.mend404, 421: words.mend421 };
  return new Lasting(words.refuses(path, String(status)), how[status] ?? words.mendOther);
}

/** @param theirs  null: unknown */
export function versionTrouble(own: number, theirs: { version: number; palpate: string } | null): Lasting {
  const what = theirs
    ? words.otherVersion(theirs.palpate, String(theirs.version), String(own))
    : words.someOtherVersion(String(own));
  return new Lasting(what, words.mendVersion);
}
