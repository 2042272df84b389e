// Errors, classified by their handling: permanent, volume not found, out of memory.

import { words } from "./words.js";

/** Permanent error, not solved by retries: cause and remedy. */
export class PermanentError extends Error {
  constructor(
    what: string,
    readonly remedy: string,
  ) {
    super(what);
  }
}
/** Error: the volume does not exist (any more); the scene may refer to another one now. */
export class VolumeNotFound extends Error {}
/** Error: insufficient graphics or main memory. */
export class NoMemory extends Error {}

export const isMemoryShort = (error: unknown): boolean => error instanceof NoMemory || error instanceof RangeError;

/** HTTP status codes of temporary refusals. */
const TRANSIENT_STATUS = [408, 425, 429];

/** Error for an unsuccessful HTTP status other than 401. */
export function errorOf(path: string, status: number): Error {
  if (status < 400 || status >= 500 || TRANSIENT_STATUS.includes(status))
    return new Error(words.answered(path, String(status)));
  if (status === 404 && path.startsWith("/api/volume/")) return new VolumeNotFound(words.notThere(path));
  const remedy: Record<number, string> = { 403: words.remedy403, 404: words.remedy404, 421: words.remedy421 };
  return new PermanentError(words.refuses(path, String(status)), remedy[status] ?? words.remedyOther);
}

/** @param theirs  versions of the server; null: unknown */
export function versionError(own: number, theirs: { version: number; palpate: string } | null): PermanentError {
  const what = theirs
    ? words.otherVersion(theirs.palpate, String(theirs.version), String(own))
    : words.someOtherVersion(String(own));
  return new PermanentError(what, words.remedyVersion);
}
