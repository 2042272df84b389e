// What this browser keeps: of the page, and of a scene by the hash of its volume, of the scenes that were seen last.

const SCENES_KEY = "palpate.scenes";
const MOST_SCENES = 30;
const keyOf = (hash: string): string => `palpate.scene.${hash}`;

/** What was kept under a key and still reads; a browser may hold anything, or refuse to hold it. */
export function recall<T>(key: string): Partial<T> {
  try {
    const kept: unknown = JSON.parse(localStorage.getItem(key) ?? "{}");
    return typeof kept === "object" && kept !== null ? (kept as Partial<T>) : {};
  } catch {
    return {};
  }
}
/** Adds to what is kept under a key. */
export function keep<T>(key: string, more: Partial<T>): void {
  try {
    localStorage.setItem(key, JSON.stringify({ ...recall<T>(key), ...more }));
  } catch {
    // full, or forbidden: then it holds until the page is closed
  }
}

export const recallScene = <T>(hash: string): Partial<T> => recall<T>(keyOf(hash));
export function keepScene<T>(hash: string, more: Partial<T>): void {
  const { seen = [] } = recall<{ seen: string[] }>(SCENES_KEY);
  if (seen[0] !== hash) {
    const now = [hash, ...seen.filter((other) => other !== hash)];
    for (const old of now.slice(MOST_SCENES)) localStorage.removeItem(keyOf(old));
    keep<{ seen: string[] }>(SCENES_KEY, { seen: now.slice(0, MOST_SCENES) });
  }
  keep<T>(keyOf(hash), more);
}
