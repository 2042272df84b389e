// Linter of the page: suspicious code, cycles of imports, and which folder of src/ may import which.

import { fileURLToPath } from "node:url";
import js from "@eslint/js";
import { createNodeResolver, importX } from "eslint-plugin-import-x";
import tseslint from "typescript-eslint";

/** Folders of src/ from the lowest layer to the highest, and the folders that each may import besides itself. */
const LOW = ["base", "words", "protocol", "state"];
const MAY_IMPORT = {
  base: [],
  words: ["base"],
  protocol: ["base", "words"],
  state: ["base", "words", "protocol"],
  drawing: LOW,
  touch: LOW,
  section: [...LOW, "drawing", "touch"],
  volume: [...LOW, "drawing", "touch"],
  panels: [...LOW, "drawing", "section", "touch", "volume"],
  training: [...LOW, "drawing", "volume", "panels"],
  worker: LOW,
  page: [...LOW, "drawing", "section", "touch", "volume", "panels", "training"],
};

const zones = Object.entries(MAY_IMPORT).map(([folder, others]) => ({
  target: `./src/${folder}`,
  from: "./src",
  except: [folder, ...others].map((one) => `./${one}`),
  message: `src/${folder} may import only ${[folder, ...others].join(", ")} (MAY_IMPORT in eslint.config.js).`,
}));

const NODE_GLOBALS = [
  "Buffer",
  "URL",
  "clearInterval",
  "clearTimeout",
  "console",
  "performance",
  "process",
  "setInterval",
  "setTimeout",
];

export default tseslint.config(
  { ignores: ["dist/", "dist-static/", ".test/"] },
  js.configs.recommended,
  tseslint.configs.recommended,
  {
    plugins: { "import-x": importX },
    linterOptions: { reportUnusedDisableDirectives: "error" },
    settings: {
      "import-x/extensions": [".ts", ".js"],
      // sources import "./x.js", as it is named once compiled
      "import-x/resolver-next": [createNodeResolver({ extensionAlias: { ".js": [".ts", ".js"] } })],
      "import-x/parsers": { "@typescript-eslint/parser": [".ts"] },
    },
    rules: {
      "import-x/no-cycle": ["error", { ignoreExternal: true }],
      "import-x/no-self-import": "error",
      "import-x/no-unresolved": "error",
      "import-x/no-duplicates": "error",
      "import-x/no-restricted-paths": ["error", { basePath: fileURLToPath(new URL(".", import.meta.url)), zones }],
      eqeqeq: ["error", "always", { null: "ignore" }],
      "no-implicit-coercion": "error",
      "object-shorthand": "error",
      "no-else-return": "error",
      "no-useless-return": "error",
      "no-lonely-if": "error",
      "no-unneeded-ternary": "error",
      // formatting is Prettier's, which leaves comments and strings as they are
      "max-len": ["error", { code: 120, tabWidth: 2, ignoreUrls: true }],
      "@typescript-eslint/consistent-type-imports": ["error", { disallowTypeAnnotations: false }],
      "@typescript-eslint/no-unused-vars": [
        "error",
        { args: "after-used", argsIgnorePattern: "^_", varsIgnorePattern: "^_$", ignoreRestSiblings: true },
      ],
    },
  },
  {
    files: ["**/*.mjs", "*.config.js"],
    languageOptions: {
      globals: Object.fromEntries(NODE_GLOBALS.map((name) => [name, "readonly"])),
    },
  },
);
