// English or German: as the browser is, or as was chosen here; kept in this browser.

import { hush } from "./announce.js";
import { byId } from "./dom.js";
import { fetchPart, reportMissingParts } from "./part.js";
import { LANGUAGES, speak, type Language } from "./words.js";

const KEY = "palpate.language";
const isKnown = (name: string | null): name is Language => name !== null && Object.hasOwn(LANGUAGES, name);

/** The first of the browser's languages that the page speaks. */
export const preferred = (languages: readonly string[]): Language =>
  languages.map((tag) => tag.toLowerCase().split("-")[0]!).find(isKnown) ?? "en";

const listeners: (() => void)[] = [];
/** What is not written by a message's name is to be written anew. */
export const onLanguage = (listener: () => void): void => void listeners.push(listener);

/** @returns when the language is there in which the page begins, or cannot be had */
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

/** The page goes on in the language it has until the other one is there, and where that cannot be fetched. */
async function change(language: Language): Promise<void> {
  const choice = byId<HTMLSelectElement>("language");
  choice.value = language;
  const isSpoken = await fetchPart("language", async () => (await speak(language), true));
  if (!isSpoken) choice.value = document.documentElement.lang;
  hush();
  for (const listener of listeners) listener();
}
