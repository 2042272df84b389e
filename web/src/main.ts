// Entry point of the page.

import { toast } from "./base/announce.js";
import { write, byId } from "./base/dom.js";
import { Page } from "./page.js";
import { applyTheme } from "./panels/theme.js";
import { anySlicer } from "./section/any_slicer.js";
import { applyLanguage } from "./words/language.js";
import { words } from "./words/words.js";

// no top-level await: modules that are imported on first use may import from this one
async function open(): Promise<void> {
  applyTheme();
  const language = applyLanguage();
  write(byId("cover-text"), words.loading);
  try {
    const page = new Page(await anySlicer(() => toast(words.noWebGl)), language);
    // browsers driven by a test
    if (navigator.webdriver) void import("./test_hook.js").then(({ openToTests }) => openToTests(page));
    void page.start();
  } catch (error) {
    write(byId("cover-text"), (error as Error).message);
  }
}
void open();
