// Modules that are imported on first use. A failure is reported on the page and retried at the next use; everything
// else works without the module, the emergency stop too.

import { byId, write } from "../base/dom.js";
import { words, type Words } from "./words.js";

export type PartName = keyof Words["parts"];

const missing = new Set<PartName>();

/** Lists the parts that could not be loaded, in the current language. */
export function reportMissingParts(): void {
  const line = byId("missing-parts");
  write(line, missing.size === 0 ? "" : words.partsMissing([...missing].map((name) => words.parts[name]).join(", ")));
  line.hidden = missing.size === 0;
}

/** @returns null if the part could not be loaded or constructed, which the page reports */
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
  /** null until it is loaded */
  now: T | null = null;
  private fetching: Promise<T | null> | null = null;

  /** @param make  imports the module and constructs the part */
  constructor(
    private readonly name: PartName,
    private readonly make: () => Promise<T>,
  ) {}

  /**
   * Loads the part once.
   * @returns null on failure
   */
  get(): Promise<T | null> {
    return (this.fetching ??= this.fetch());
  }
  private async fetch(): Promise<T | null> {
    this.now = await fetchPart(this.name, this.make);
    // retried at the next use
    if (this.now === null) this.fetching = null;
    return this.now;
  }
}
