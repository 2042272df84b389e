import { defineConfig, mergeConfig } from "vite";
import page from "./vite.config.js";

/** Policy of the page, which a server of palpate sends as a header: everything comes from the page's own origin. */
const POLICY =
  "default-src 'none'; script-src 'self' 'wasm-unsafe-eval'; style-src 'self'; img-src 'self' blob: data:; " +
  "connect-src 'self'; worker-src 'self'; base-uri 'none'; form-action 'none'";

const startsInBrowser = {
  name: "starts-in-browser",
  transformIndexHtml: {
    order: "pre" as const,
    handler: (html: string) =>
      html
        .replace("/src/main.ts", "/src/start_in_browser.ts")
        .replace(
          '<meta charset="utf-8">',
          `<meta charset="utf-8">\n<meta http-equiv="Content-Security-Policy" content="${POLICY}">`,
        ),
  },
};

// The page as a folder of files for any static server, in any folder of it; `make web` adds palpate.wasm to assets/.
export default mergeConfig(
  page,
  defineConfig({
    base: "./",
    plugins: [startsInBrowser],
    worker: { format: "es", rollupOptions: { output: { entryFileNames: "assets/[name].js" } } },
    build: { outDir: "dist-static" },
  }),
);
