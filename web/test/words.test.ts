import assert from "node:assert/strict";
import { readdirSync, readFileSync } from "node:fs";
import { join } from "node:path";
import test from "node:test";
import ts from "typescript";
import { preferred } from "../src/words/language.js";
import { LANGUAGES } from "../src/words/words.js";
import { en } from "../src/words/en.js";

/** Paths and texts of all messages; functions are called with placeholders. */
function messages(of: object, path = ""): [string, string][] {
  return Object.entries(of).flatMap(([key, value]): [string, string][] => {
    const here = `${path}${key}`;
    if (typeof value === "string") return [[here, value]];
    if (typeof value === "function")
      return [[here, value(...Array.from({ length: value.length }, (_, n) => `‹${n}›`))]];
    return messages(value, `${here}.`);
  });
}
const marks = (text: string): string[] =>
  [...text.matchAll(/‹\d›|`[^`]*`/g)].map(([mark]) => (mark.startsWith("`") ? "`" : mark)).sort();

test("every language has every message, with equal parameters and numbers of keys", async () => {
  const english = messages(en);
  for (const [name, fetchWords] of Object.entries(LANGUAGES)) {
    const own = messages(await fetchWords());
    assert.deepEqual(
      own.map(([key]) => key),
      english.map(([key]) => key),
      name,
    );
    for (const [n, [key, text]] of own.entries()) {
      assert.ok(text.trim().length > 0, `${name}: ${key}`);
      assert.deepEqual(marks(text), marks(english[n]![1]), `${name}: ${key}`);
    }
  }
});

test("the first supported language of the browser is selected, else English", () => {
  assert.equal(preferred(["xx-XX", "de-AT", "en"]), "de");
  assert.equal(preferred(["EN-gb", "de"]), "en");
  assert.equal(preferred(["xx", "toString"]), "en");
  assert.equal(preferred([]), "en");
});

test("the page has no text outside the catalogues", () => {
  const html = readFileSync("index.html", "utf8");
  // the menu of languages has each one by its own name
  const choices = [...html.matchAll(/<option value="(\w+)" lang="(\w+)" title="([^"]+)">(\w+)<\/option>/g)];
  const languages = Object.keys(LANGUAGES);
  for (const place of [1, 2])
    assert.deepEqual(
      choices.map((choice) => choice[place]),
      languages,
    );
  // names and symbols that are equal in all languages
  const same = [
    "palpate",
    "–",
    "N",
    "?",
    "↶",
    "↷",
    "‹",
    "›",
    ...choices.map((choice) => choice[4]!),
    "LPS (DICOM)",
    "RAS (Slicer)",
  ];
  const text = [...html.matchAll(/>([^<]+)</g)]
    .map(([, words]) => words!.trim())
    .filter((words) => words && !same.includes(words));
  assert.deepEqual(text, []);
  const said = [...html.matchAll(/ (?:title|alt|aria-label|placeholder)="([^"]+)"/g)].map(([, words]) => words!);
  assert.deepEqual(
    said,
    choices.map((choice) => choice[3]),
  );
  const named = [...html.matchAll(/ data-words(?:-title|-label|-placeholder)?="([^"]*)"/g)].map(([, key]) => key!);
  assert.ok(named.length > 80);
  assert.deepEqual(
    named.filter((key) => typeof en[key as keyof typeof en] !== "string"),
    [],
  );
});

/** Texts that are not translated: names, fields of file formats, and internal errors that users never see. */
const SAME = [
  "palpate",
  "patient (LPS), mm; forces in World, N",
  "a matrix that cannot be inverted",
  "no WebGL 2",
  "The graphics were lost.",
];
const KEYS = ["Space", "Enter", "Escape", "Home"];
/** Index of the argument that is displayed on the page, for each function. */
const CALLS: Record<string, number> = {
  write: 1,
  text: 1,
  toast: 0,
  fillText: 0,
  Error: 0,
  PermanentError: 0,
  VolumeNotFound: 0,
  NoMemory: 0,
  WireError: 0,
  Option: 0,
};
const WRITTEN = ["textContent", "innerText", "title", "ariaLabel", "placeholder"];

/** Literal texts in a source file: sentences, capitalised words, and arguments of functions that write to the page. */
function ownWords(file: string, source: string): string[] {
  const found: string[] = [];
  const last = (node: ts.Node) => node.getText().split(".").at(-1)!;
  const isWritten = (node: ts.Node): boolean => {
    const { parent } = node;
    if (ts.isCallExpression(parent) || ts.isNewExpression(parent))
      return parent.arguments?.indexOf(node as ts.Expression) === CALLS[last(parent.expression)];
    if (ts.isPropertyAssignment(parent)) return WRITTEN.includes(parent.name.getText());
    if (ts.isBinaryExpression(parent) && parent.operatorToken.kind === ts.SyntaxKind.EqualsToken)
      return WRITTEN.includes(last(parent.left));
    const isPart =
      ts.isTemplateSpan(parent) ||
      ts.isTemplateExpression(parent) ||
      ts.isConditionalExpression(parent) ||
      ts.isParenthesizedExpression(parent);
    return isPart && isWritten(parent);
  };
  const isStyle = (node: ts.Node): boolean =>
    ts.findAncestor(
      node,
      (one) =>
        (ts.isPropertyAssignment(one) && one.name.getText() === "className") ||
        (ts.isBinaryExpression(one) && /\.(className|font)$/.test(one.left.getText())),
    ) !== undefined;
  const visit = (node: ts.Node): void => {
    // names of messages are checked by the type system
    if (ts.isCallExpression(node) && last(node.expression) === "setMessages")
      return void node.arguments.slice(0, 1).forEach(visit);
    const isText =
      (ts.isStringLiteralLike(node) && !ts.isImportDeclaration(node.parent)) ||
      ts.isTemplateHead(node) ||
      ts.isTemplateMiddleOrTemplateTail(node);
    const text = isText ? node.text : "";
    const isSaid =
      /[A-Za-z]{2,} [a-z]{2,}/.test(text) ||
      /^[A-Z][a-z]{2,}$/.test(text) ||
      (/[A-Za-z]{3,}/.test(text) && isWritten(node));
    // template literals of several lines are shaders
    const isProgram = (ts.findAncestor(node, ts.isTemplateExpression) ?? node).getText().includes("\n");
    if (isSaid && !isProgram && !isStyle(node) && ![...SAME, ...KEYS].includes(text.trim()))
      found.push(`${file}: ${text}`);
    ts.forEachChild(node, visit);
  };
  visit(ts.createSourceFile(file, source, ts.ScriptTarget.ES2022, true));
  return found;
}

test("the sources have no text outside the catalogues", () => {
  assert.deepEqual(
    ownWords(
      "example.ts",
      "write(byId(`a`), x ? `free` : `${n} mm`); box.textContent = 'Paused'; toast(words.free);",
    ).map((one) => one.split(": ")[1]),
    ["free", "Paused"],
  );
  const dictionaries = [...Object.keys(LANGUAGES), "in_browser"].map((name) => join("words", `${name}.ts`));
  const files = readdirSync("src", { recursive: true, encoding: "utf8" }).filter(
    (name) => name.endsWith(".ts") && !dictionaries.includes(name),
  );
  assert.ok(files.length > 30);
  assert.deepEqual(
    files.flatMap((name) => ownWords(name, readFileSync(join("src", name), "utf8"))),
    [],
  );
});
