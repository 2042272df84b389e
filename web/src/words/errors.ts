// Errors, classified by the reaction that they require.

import { words } from "./words.js";

/** Permanent error, not solved by retries: cause and remedy. */
export class Lasting extends Error {
  constructor(
    what: string,
    readonly how: string,
  ) {
    super(what);
  }
}
/** Error: the volume does not exist (any more); the scene may refer to another one now. */
export class Gone extends Error {}
/** Error: insufficient graphics or main memory. */
export class NoMemory extends Error {}

export const isMemoryShort = (error: unknown): boolean => error instanceof NoMemory || error instanceof RangeError;

/** HTTP status codes of temporary refusals. */
const PASSING = [408, 425, 429];

/** Error for an unsuccessful HTTP status other than 401. */
export function errorOf(path: string, status: number): Error {
  if (status < 400 || status >= 500 || PASSING.includes(status)) return new Error(words.answered(path, String(status)));
  if (status === 404 && path.startsWith("/api/volume/")) return new Gone(words.notThere(path));
  const how: Record<number, string> = { 403: words.mend403, 404: words.mend404, 421: words.mend421 };
  return new Lasting(words.refuses(path, String(status)), how[status] ?? words.mendOther);
}

/** @param theirs  versions of the server; null: unknown */
export function versionError(own: number, theirs: { version: number; palpate: string } | null): Lasting {
  const what = theirs
    ? words.otherVersion(theirs.palpate, String(theirs.version), String(own))
    : words.someOtherVersion(String(own));
  return new Lasting(what, words.mendVersion);
}
