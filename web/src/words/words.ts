// Texts of the page in the current language. Elements store the names of their messages, so that a change of the
// language rewrites them.

import { signal } from "@preact/signals-core";
import { write } from "../base/dom.js";
import { en, type Words } from "./en.js";

export type { Words };
/** Loaders of the languages; English is bundled, in case others cannot be loaded. */
export const LANGUAGES = {
  en: async () => en,
  de: async () => (await import("./de.js")).de,
} satisfies Record<string, () => Promise<Words>>;
export type Language = keyof typeof LANGUAGES;

const current = signal<Words>(en);
/** Texts in the current language. Effects that read one run again when the language changes. */
export const words = new Proxy({} as Words, {
  get: (_, name) => current.value[name as keyof Words],
});

export const capitalized = (text: string): string => text.charAt(0).toUpperCase() + text.slice(1);

/** Name of a message without parameters. */
export type Message = { [K in keyof Words]: Words[K] extends string ? K : never }[keyof Words];
export type MessageAbout = { [K in keyof Words]: Words[K] extends (name: string) => string ? K : never }[keyof Words];

/** Parts of an element that display messages, and the data attributes that store the messages' names. */
const PLACES = {
  text: { names: "words", set: (target: HTMLElement, said: string) => write(target, said) },
  title: { names: "wordsTitle", set: (target: HTMLElement, said: string) => (target.title = said) },
  label: { names: "wordsLabel", set: (target: HTMLElement, said: string) => (target.ariaLabel = said) },
  placeholder: {
    names: "wordsPlaceholder",
    set: (target: HTMLElement, said: string) => ((target as HTMLInputElement).placeholder = said),
  },
} as const;
type Messages = Partial<Record<keyof typeof PLACES, Message>>;
type MessagesAbout = Partial<Record<keyof typeof PLACES, Message | MessageAbout>>;

/**
 * Sets the messages of an element, and returns it.
 * @param about  name that messages with a parameter are about
 */
export function setMessages<E extends HTMLElement>(target: E, messages: Messages): E;
export function setMessages<E extends HTMLElement>(target: E, messages: MessagesAbout, about: string): E;
export function setMessages<E extends HTMLElement>(target: E, messages: MessagesAbout, about?: string): E {
  for (const [place, message] of Object.entries(messages))
    target.dataset[PLACES[place as keyof typeof PLACES].names] = message;
  if (about !== undefined) target.dataset.about = about;
  applyMessages(target);
  return target;
}

function applyMessages(target: HTMLElement): void {
  for (const { names, set } of Object.values(PLACES)) {
    const message = target.dataset[names];
    if (message === undefined) continue;
    const said = words[message as Message | MessageAbout];
    set(target, typeof said === "string" ? said : said(target.dataset.about ?? ""));
  }
}

let wanted: Language = "en";
/** Loads a language and switches to it, unless another one was requested meanwhile. */
export async function setLanguage(language: Language): Promise<void> {
  wanted = language;
  const fetched = await LANGUAGES[language]();
  if (wanted !== language) return;
  document.documentElement.lang = language;
  current.value = fetched;
  for (const target of document.querySelectorAll<HTMLElement>(
    "[data-words], [data-words-title], [data-words-label], [data-words-placeholder]",
  ))
    applyMessages(target);
}
