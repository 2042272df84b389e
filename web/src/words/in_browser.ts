// Texts of the page without a server, which only its entry point loads.

import type { Language } from "./words.js";

interface InBrowserWords {
  choose: string;
  scenes: { knee: string; lump: string; gland: string; mastoid: string };
  stays: string;
  preparing: string;
  failed: (why: string) => string;
}

export const IN_BROWSER: Record<Language, InBrowserWords> = {
  en: {
    choose: "Touch a scan. palpate runs in this page: nothing is installed.",
    scenes: {
      knee: "A knee",
      lump: "Find the lump",
      gland: "A gland on the jaw",
      mastoid: "A temporal bone to drill",
    },
    stays: "Nothing leaves this computer.",
    preparing: "Preparing the scene …",
    failed: (why) => `The scene could not be prepared: ${why}. Reload the page to try again.`,
  },
  de: {
    choose: "Berühren Sie eine Aufnahme. palpate läuft in dieser Seite: Es wird nichts installiert.",
    scenes: {
      knee: "Ein Knie",
      lump: "Den Knoten finden",
      gland: "Eine Drüse am Kiefer",
      mastoid: "Ein Felsenbein zum Fräsen",
    },
    stays: "Nichts verlässt diesen Rechner.",
    preparing: "Die Szene wird vorbereitet …",
    failed: (why) => `Die Szene konnte nicht vorbereitet werden: ${why}. Laden Sie die Seite neu.`,
  },
};
