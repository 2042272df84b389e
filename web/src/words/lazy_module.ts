// Modules imported on first use. A failure is reported on the page and retried at the next use. Everything else,
// including the emergency stop, works without the module.

import { byId, write } from "../base/dom.js";
import { words, type Words } from "./words.js";

export type ModuleName = keyof Words["parts"];

const missing = new Set<ModuleName>();

/** Lists the modules that could not be loaded, in the current language. */
function reportMissingModules(): void {
  const line = byId("missing-parts");
  write(line, missing.size === 0 ? "" : words.partsMissing([...missing].map((name) => words.parts[name]).join(", ")));
  line.hidden = missing.size === 0;
}

/**
 * Loads and constructs a module.
 * @returns null on failure, which is reported on the page
 */
export async function loadModule<T>(name: ModuleName, make: () => Promise<T>): Promise<T | null> {
  let made: T | null = null;
  try {
    made = await make();
    missing.delete(name);
  } catch (error) {
    console.error(error);
    missing.add(name);
  }
  reportMissingModules();
  return made;
}

/** Module that is imported and constructed on first use. */
export class LazyModule<T> {
  /** The constructed module; null until it is loaded. */
  value: T | null = null;
  private fetching: Promise<T | null> | null = null;

  /** @param make  import of the module and construction of what it provides */
  constructor(
    private readonly name: ModuleName,
    private readonly make: () => Promise<T>,
  ) {}

  /**
   * The module, loaded on the first call.
   * @returns null on failure
   */
  get(): Promise<T | null> {
    return (this.fetching ??= this.fetch());
  }
  private async fetch(): Promise<T | null> {
    this.value = await loadModule(this.name, this.make);
    // after a failure, the next use retries
    if (this.value === null) this.fetching = null;
    return this.value;
  }
}
