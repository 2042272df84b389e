// Entry point of the page.

import { write, byId } from "./base/dom.js";
import { Page } from "./page.js";
import { applyTheme } from "./panels/theme.js";
import { applyLanguage } from "./words/language.js";
import { words } from "./words/words.js";

applyTheme();
const language = applyLanguage();
write(byId("cover-text"), words.loading);
try {
  const page = new Page(language);
  // browsers driven by a test
  if (navigator.webdriver) void import("./test_hook.js").then(({ openToTests }) => openToTests(page));
  void page.start();
} catch (error) {
  write(byId("cover-text"), (error as Error).message);
}
