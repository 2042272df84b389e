// English or German: the browser's language, or the one chosen here, which this browser stores.

import { hush } from "../base/announce.js";
import { byId } from "../base/dom.js";
import { fetchPart, reportMissingParts } from "./part.js";
import { LANGUAGES, speak, type Language } from "./words.js";

const KEY = "palpate.language";
const isKnown = (name: string | null): name is Language => name !== null && Object.hasOwn(LANGUAGES, name);

/** First of the browser's languages in which the page is available. */
export const preferred = (languages: readonly string[]): Language =>
  languages.map((tag) => tag.toLowerCase().split("-")[0]!).find(isKnown) ?? "en";

const listeners: (() => void)[] = [];
/** Registers a listener that rewrites texts without a message name after a change of the language. */
export const onLanguage = (listener: () => void): void => void listeners.push(listener);

/** @returns resolves when the initial language is loaded, or cannot be */
export function applyLanguage(): Promise<void> {
  const choice = byId<HTMLSelectElement>("language");
  const kept = localStorage.getItem(KEY);
  onLanguage(reportMissingParts);
  choice.addEventListener("change", () => {
    localStorage.setItem(KEY, choice.value);
    void change(choice.value as Language);
  });
  choice.value = "en";
  void speak("en");
  const first = isKnown(kept) ? kept : preferred(navigator.languages);
  return first === "en" ? Promise.resolve() : change(first);
}

/** The page keeps its language until the new one is loaded, also if that fails. */
async function change(language: Language): Promise<void> {
  const choice = byId<HTMLSelectElement>("language");
  choice.value = language;
  const isSpoken = await fetchPart("language", async () => (await speak(language), true));
  if (!isSpoken) choice.value = document.documentElement.lang;
  hush();
  for (const listener of listeners) listener();
}
