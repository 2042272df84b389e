// Browser storage: settings of the page, and of recent scenes by their volume's hash.

const SCENES_KEY = "palpate.scenes";
const MAX_SCENES = 30;
const keyOf = (hash: string): string => `palpate.scene.${hash}`;

/** Value stored under a key; empty if it cannot be parsed or storage is unavailable. */
export function recall<T>(key: string): Partial<T> {
  try {
    const stored: unknown = JSON.parse(localStorage.getItem(key) ?? "{}");
    return typeof stored === "object" && stored !== null ? (stored as Partial<T>) : {};
  } catch {
    return {};
  }
}
/** Merges values into those stored under a key. */
export function store<T>(key: string, more: Partial<T>): void {
  try {
    localStorage.setItem(key, JSON.stringify({ ...recall<T>(key), ...more }));
  } catch {
    // storage is full or forbidden: settings last until the page is closed
  }
}

export const recallScene = <T>(hash: string): Partial<T> => recall<T>(keyOf(hash));
export function storeScene<T>(hash: string, more: Partial<T>): void {
  const { seen = [] } = recall<{ seen: string[] }>(SCENES_KEY);
  if (seen[0] !== hash) {
    const now = [hash, ...seen.filter((other) => other !== hash)];
    for (const old of now.slice(MAX_SCENES)) localStorage.removeItem(keyOf(old));
    store<{ seen: string[] }>(SCENES_KEY, { seen: now.slice(0, MAX_SCENES) });
  }
  store<T>(keyOf(hash), more);
}
