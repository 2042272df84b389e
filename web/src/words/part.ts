// Modules imported on first use. A failure is reported on the page and retried at the next use. Everything else,
// including the emergency stop, works without the module.

import { byId, write } from "../base/dom.js";
import { words, type Words } from "./words.js";

export type PartName = keyof Words["parts"];

const missing = new Set<PartName>();

/** Lists the parts that could not be loaded, in the current language. */
function reportMissingParts(): void {
  const line = byId("missing-parts");
  write(line, missing.size === 0 ? "" : words.partsMissing([...missing].map((name) => words.parts[name]).join(", ")));
  line.hidden = missing.size === 0;
}

/**
 * Loads and constructs a part.
 * @returns null on failure, which is reported on the page
 */
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
  /** The part; null until it is loaded. */
  now: T | null = null;
  private fetching: Promise<T | null> | null = null;

  /** @param make  import of the module and construction of the part */
  constructor(
    private readonly name: PartName,
    private readonly make: () => Promise<T>,
  ) {}

  /**
   * Part, loaded on the first call.
   * @returns null on failure
   */
  get(): Promise<T | null> {
    return (this.fetching ??= this.fetch());
  }
  private async fetch(): Promise<T | null> {
    this.now = await fetchPart(this.name, this.make);
    // after a failure, the next use retries
    if (this.now === null) this.fetching = null;
    return this.now;
  }
}
