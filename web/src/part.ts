// Parts of the page that the browser fetches when they are first used. One that cannot be fetched is reported on the page and tried again at
// its next use; everything else goes on without it, the emergency stop too.

import { byId, write } from "./dom.js";
import { words, type Words } from "./words.js";

export type PartName = keyof Words["parts"];

const missing = new Set<PartName>();

/** Lists the parts that could not be fetched, in the language of the page. */
export function reportMissingParts(): void {
  const line = byId("missing-parts");
  write(line, missing.size === 0 ? "" : words.partsMissing([...missing].map((name) => words.parts[name]).join(", ")));
  line.hidden = missing.size === 0;
}

/** @returns null where it could not be fetched or made, which the page reports */
export async function fetchPart<T>(name: PartName, make: () => Promise<T>): Promise<T | null> {
  let made: T | null = null;
  try {
    made = await make();
    missing.delete(name);
  } catch (error) {
    console.error(error);
    missing.add(name);
  }
  reportMissingParts();
  return made;
}

export class Part<T> {
  /** null until it has been fetched */
  now: T | null = null;
  private fetching: Promise<T | null> | null = null;

  /** @param make  imports its module and makes it */
  constructor(private readonly name: PartName, private readonly make: () => Promise<T>) {}

  /** Fetches it unless that has been done or is under way. @returns null where that failed */
  get(): Promise<T | null> {
    return (this.fetching ??= this.fetch());
  }
  private async fetch(): Promise<T | null> {
    this.now = await fetchPart(this.name, this.make);
    // the next use tries again
    if (this.now === null) this.fetching = null;
    return this.now;
  }
}
