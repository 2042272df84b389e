// The words that the page says now, and how elements come to say them: an element names its messages, so that another language is
// only read into it.

import { write } from "./dom.js";
import { en, type Words } from "./words/en.js";

export type { Words };
/** How the words of each language are fetched; English is there from the start, in case they cannot be. */
export const LANGUAGES = {
  en: async () => en,
  de: async () => (await import("./words/de.js")).de,
} satisfies Record<string, () => Promise<Words>>;
export type Language = keyof typeof LANGUAGES;

/** In the language that was chosen last. */
export let words: Words = en;

/** Messages that are text, and those that are about something with a name. */
export type Message = { [K in keyof Words]: Words[K] extends string ? K : never }[keyof Words];
export type MessageAbout = { [K in keyof Words]: Words[K] extends (name: string) => string ? K : never }[keyof Words];

/** Where an element says something, and the data attribute that names the message. */
const PLACES = {
  text: { names: "words", set: (target: HTMLElement, said: string) => write(target, said) },
  title: { names: "wordsTitle", set: (target: HTMLElement, said: string) => (target.title = said) },
  label: { names: "wordsLabel", set: (target: HTMLElement, said: string) => (target.ariaLabel = said) },
  placeholder: { names: "wordsPlaceholder", set: (target: HTMLElement, said: string) => ((target as HTMLInputElement).placeholder = said) },
} as const;
type Says = Partial<Record<keyof typeof PLACES, Message>>;
type SaysAbout = Partial<Record<keyof typeof PLACES, Message | MessageAbout>>;

/** @param about  the name of what its messages are about */
export function says<E extends HTMLElement>(target: E, messages: Says): E;
export function says<E extends HTMLElement>(target: E, messages: SaysAbout, about: string): E;
export function says<E extends HTMLElement>(target: E, messages: SaysAbout, about?: string): E {
  for (const [place, message] of Object.entries(messages)) target.dataset[PLACES[place as keyof typeof PLACES].names] = message;
  if (about !== undefined) target.dataset.about = about;
  read(target);
  return target;
}

function read(target: HTMLElement): void {
  for (const { names, set } of Object.values(PLACES)) {
    const message = target.dataset[names];
    if (message === undefined) continue;
    const said = words[message as Message | MessageAbout];
    set(target, typeof said === "string" ? said : said(target.dataset.about ?? ""));
  }
}

let wanted: Language = "en";
/** Fetches a language and switches to it, unless another one has been asked for meanwhile. */
export async function speak(language: Language): Promise<void> {
  wanted = language;
  const fetched = await LANGUAGES[language]();
  if (wanted !== language) return;
  words = fetched;
  document.documentElement.lang = language;
  for (const target of document.querySelectorAll<HTMLElement>("[data-words], [data-words-title], [data-words-label], [data-words-placeholder]")) read(target);
}
