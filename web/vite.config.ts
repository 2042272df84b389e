import { defineConfig } from "vite";

// five files with fixed names: they are compiled into palpate (CMakeLists.txt)
export default defineConfig({
  base: "/",
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
        assetFileNames: "assets/viewer[extname]",
        inlineDynamicImports: true,
      },
    },
  },
});
