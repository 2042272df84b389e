// Keys of the page, and the help that lists them.

import { effect } from "@preact/signals-core";
import { byId, element } from "../base/dom.js";
import type { History } from "../state/history.js";
import { words } from "../words/words.js";

const LETTERS_KEY = "palpate.letters";

/** Actions of keys, by the lower-case key; they get the event for its modifiers and repeats. */
export type KeyActions = Record<string, (event: KeyboardEvent) => unknown>;

export class Keys {
  /** @param stop  requests an emergency stop */
  constructor(
    private readonly history: History,
    private readonly stop: () => void,
    private readonly actions: KeyActions,
  ) {
    byId("help").addEventListener("click", () => this.toggleHelp());
    byId("help-close").addEventListener("click", () => this.showHelp(false));
    // single-key shortcuts can be disabled, for speech input; the emergency stop stays enabled
    const letters = byId<HTMLInputElement>("letters");
    letters.checked = localStorage.getItem(LETTERS_KEY) !== "off";
    letters.addEventListener("change", () => localStorage.setItem(LETTERS_KEY, letters.checked ? "on" : "off"));
    window.addEventListener("keydown", (event) => this.press(event), { capture: true });
    effect(() =>
      byId("gestures").replaceChildren(
        ...words.gestures.map(([how, what]) =>
          element("tr", {}, element("th", { scope: "row" }, ...withKeys(how)), element("td", {}, ...withKeys(what))),
        ),
      ),
    );
  }

  /**
   * Handles a key. The space bar is the emergency stop for every focus except text fields, so that switches and buttons
   * are operated with Enter. Number fields are no text fields, because numbers contain no spaces.
   */
  private press(event: KeyboardEvent): void {
    const target = event.target as HTMLElement;
    const hasSpaces = target.matches("input[type=password], input[type=text]:not(#arm-code), input[type=search]");
    const writes = hasSpaces || target.matches("input[type=number], #arm-code");
    if ((event.key === " " || event.code === "Space") && !hasSpaces) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) this.stop();
      return;
    }
    if (event.key === "Enter" && target.matches("input[type=checkbox]")) target.click();
    if (event.key === "Escape") this.showHelp(false);
    const isUndo = (event.ctrlKey || event.metaKey) && !event.altKey && event.key.toLowerCase() === "z";
    if (isUndo && !writes) {
      event.preventDefault();
      void (event.shiftKey ? this.history.redo() : this.history.undo());
      return;
    }
    if (
      writes ||
      target.matches("select") ||
      event.ctrlKey ||
      event.metaKey ||
      event.altKey ||
      document.querySelector("dialog[open]")
    )
      return;
    if (!byId<HTMLInputElement>("letters").checked) return;
    if (event.key === "?") this.toggleHelp();
    else this.actions[event.key.toLowerCase()]?.(event);
  }

  private toggleHelp(): void {
    this.showHelp(byId("help-box").hidden);
  }
  /** Opens or closes the help, which is not modal, so that the emergency stop stays within reach of the mouse. */
  private showHelp(isShown: boolean): void {
    const box = byId("help-box");
    if (box.hidden !== isShown) return;
    box.hidden = !isShown;
    byId("help").setAttribute("aria-expanded", String(isShown));
    if (isShown) box.focus();
    else if (box.contains(document.activeElement) || document.activeElement === document.body) byId("help").focus();
  }
}

/** Nodes of a text in which keys stand between backticks. */
const withKeys = (text: string): (Node | string)[] =>
  text.split("`").map((part, n) => (n % 2 === 1 ? element("kbd", {}, part) : part));
