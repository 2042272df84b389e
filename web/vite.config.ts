import { defineConfig } from "vite";

/**
 * Removes indentation, optional quotes of attributes and, outside of forms, where it has no effect, type=button from
 * index.html: a fifth of its size.
 */
const compactHtml = {
  name: "compact-html",
  transformIndexHtml: (html: string) =>
    html
      .replace(/^ +/gm, "")
      .replace(/="([\w-]+)"(?=[ >])/g, "=$1")
      .replace(/<form[^]*?<\/form>| type=button(?=[ >])/g, (found) => (found.startsWith("<form") ? found : "")),
};

/** Removes the indentation and the comment lines of shaders, which the minifier leaves in template literals. */
const withoutShaderComments = {
  name: "without-shader-comments",
  generateBundle: (_options: unknown, bundle: Record<string, { type: string; code?: string }>) => {
    for (const chunk of Object.values(bundle))
      if (chunk.type === "chunk") chunk.code = chunk.code!.replace(/^ +/gm, "").replace(/^\/\/.*\n/gm, "");
  },
};

// Files have fixed names, because they are compiled into palpate (CMakeLists.txt). A module that is imported
// dynamically is a file of its own, assets/viewer_NAME.js.
export default defineConfig({
  base: "/",
  plugins: [compactHtml, withoutShaderComments],
  worker: { format: "es", rollupOptions: { output: { entryFileNames: "assets/viewer_worker.js" } } },
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
        chunkFileNames: "assets/viewer_[name].js",
        assetFileNames: "assets/viewer[extname]",
      },
    },
  },
});
