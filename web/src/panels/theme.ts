// Theme of the page: light, dark or the system's, stored by the browser.

import { signal } from "@preact/signals-core";
import { byId } from "../base/dom.js";
import { setMessages } from "../words/words.js";

type Theme = "system" | "light" | "dark";
const ORDER: Theme[] = ["system", "light", "dark"];
const MESSAGES = { system: "themeSystem", light: "themeLight", dark: "themeDark" } as const;
const KEY = "palpate.theme";
const colours = signal(new Map<string, string>()); // cache of the theme's colours, by name
const systemIsDark = matchMedia("(prefers-color-scheme: dark)");

function chosen(): Theme {
  const stored = localStorage.getItem(KEY) as Theme;
  return ORDER.includes(stored) ? stored : "system";
}
export function applyTheme(): void {
  const theme = chosen();
  document.documentElement.dataset.theme = theme === "system" ? (systemIsDark.matches ? "dark" : "light") : theme;
  setMessages(byId("theme"), { text: MESSAGES[theme] });
  colours.value = new Map();
}
/** Value of a custom property of the style sheet. */
export function themeColour(property: string): string {
  let colour = colours.value.get(property);
  if (colour === undefined) {
    colour = getComputedStyle(document.documentElement).getPropertyValue(property);
    colours.value.set(property, colour);
  }
  return colour;
}
export function nextTheme(): void {
  localStorage.setItem(KEY, ORDER[(ORDER.indexOf(chosen()) + 1) % ORDER.length]!);
  applyTheme();
}
systemIsDark.addEventListener("change", applyTheme);
