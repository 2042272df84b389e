// Language of the page: the browser's, or the one chosen by the user, which the browser stores.

import { discardAnnouncements } from "../base/announce.js";
import { byId } from "../base/dom.js";
import { loadModule } from "./lazy_module.js";
import { LANGUAGES, setLanguage, type Language } from "./words.js";

const KEY = "palpate.language";
const isKnown = (name: string | null): name is Language => name !== null && Object.hasOwn(LANGUAGES, name);

/** First of the browser's languages in which the page is available, else English. */
export const preferred = (languages: readonly string[]): Language =>
  languages.map((tag) => tag.toLowerCase().split("-")[0]!).find(isKnown) ?? "en";

/** Applies the initial language; resolves when it is loaded or has failed to load. */
export function applyLanguage(): Promise<void> {
  const choice = byId<HTMLSelectElement>("language");
  const stored = localStorage.getItem(KEY);
  choice.addEventListener("change", () => {
    localStorage.setItem(KEY, choice.value);
    void change(choice.value as Language);
  });
  choice.value = "en";
  void setLanguage("en");
  const first = isKnown(stored) ? stored : preferred(navigator.languages);
  return first === "en" ? Promise.resolve() : change(first);
}

/** Changes the language. The previous one is kept until the new one is loaded, and if that fails. */
async function change(language: Language): Promise<void> {
  const choice = byId<HTMLSelectElement>("language");
  choice.value = language;
  const isSpoken = await loadModule("language", async () => (await setLanguage(language), true));
  if (!isSpoken) choice.value = document.documentElement.lang;
  discardAnnouncements();
}
