import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import { defineConfig, type Plugin } from "vite";

/** Puts the licences of what is in the bundle on top of it, as they ask for. */
function licences(): Plugin {
  return {
    name: "licences",
    generateBundle(_options, bundle) {
      for (const chunk of Object.values(bundle)) {
        if (chunk.type !== "chunk") continue;
        const folders = new Set(Object.keys(chunk.modules)
          .map((id) => /\/.*\/node_modules\/(?:@[^/]+\/)?[^/]+/.exec(id)?.[0])
          .filter((folder) => folder !== undefined));
        const texts = [...folders].sort().map((folder) => {
          const { name, version, license } = JSON.parse(readFileSync(join(folder, "package.json"), "utf8"));
          const file = readdirSync(folder).find((entry) => /^licen[cs]e/i.test(entry));
          const text = file ? readFileSync(join(folder, file), "utf8").trim() : "";
          return `${name} ${version}, ${license}\n\n${text.replaceAll("*/", "* /")}`;
        });
        chunk.code = `/*!\n${texts.join("\n\n\n")}\n*/\n${chunk.code}`;
      }
    },
  };
}

// four files with fixed names: they are compiled into palpate (CMakeLists.txt)
export default defineConfig({
  base: "/",
  plugins: [licences()],
  build: {
    target: "es2022",
    emptyOutDir: true,
    assetsInlineLimit: 0,
    cssCodeSplit: false,
    modulePreload: false,
    reportCompressedSize: false,
    chunkSizeWarningLimit: 2000,
    rollupOptions: {
      output: {
        entryFileNames: "assets/viewer.js",
        assetFileNames: "assets/viewer[extname]",
        inlineDynamicImports: true,
      },
    },
  },
});
