// Texts of the page without a server, which only its entry point loads.

import type { Language } from "./words.js";

interface InBrowserWords {
  choose: string;
  scenes: { knee: string; lump: string; gland: string; mastoid: string };
  own: string; // button that chooses files
  ownAbout: string;
  contents: string;
  contentsOf: { values: string; labels: string; scan: string };
  stays: string;
  preparing: string;
  reading: string;
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
    own: "Your own scan …",
    ownAbout:
      "Or drop files here: a label map (NRRD, .seg.nrrd, NIfTI or MetaImage), its scan if you like, and a table that " +
      "names the labels if the file does not. Structures get their stiffness by their names.",
    contents: "A volume on its own is",
    contentsOf: { values: "what its values look like", labels: "a label map", scan: "a scan" },
    stays: "Nothing is uploaded: your files are read in this page, and nothing leaves this computer.",
    preparing: "Preparing the scene …",
    reading: "Reading the files …",
    failed: (why) => `This could not be opened: ${why}.`,
  },
  de: {
    choose: "Berühren Sie eine Aufnahme. palpate läuft in dieser Seite: Es wird nichts installiert.",
    scenes: {
      knee: "Ein Knie",
      lump: "Den Knoten finden",
      gland: "Eine Drüse am Kiefer",
      mastoid: "Ein Felsenbein zum Fräsen",
    },
    own: "Ihre eigene Aufnahme …",
    ownAbout:
      "Oder legen Sie Dateien hier ab: eine Segmentierung (NRRD, .seg.nrrd, NIfTI oder MetaImage), gern mit ihrer " +
      "Aufnahme, und eine Tabelle mit den Namen der Strukturen, falls die Datei sie nicht enthält. Strukturen " +
      "erhalten ihre Steifigkeit nach ihrem Namen.",
    contents: "Ein Volumen allein ist",
    contentsOf: { values: "was seine Werte nahelegen", labels: "eine Segmentierung", scan: "eine Aufnahme" },
    stays: "Nichts wird hochgeladen: Ihre Dateien werden in dieser Seite gelesen, und nichts verlässt diesen Rechner.",
    preparing: "Die Szene wird vorbereitet …",
    reading: "Die Dateien werden gelesen …",
    failed: (why) => `Das ließ sich nicht öffnen: ${why}.`,
  },
};
