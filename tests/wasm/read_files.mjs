// Loads volumes with palpate.wasm, each in an instance of its own, from its folder.
//
// usage: read_files.mjs PALPATE.WASM LIST
//
// LIST is a JSON array of [folder, scene, segmentation or null]. Prints a JSON array of objects: { problem }, or the
// model's { hash, dims, spacing, direction, origin, labels, scan }, the last two as SHA-256.

import { createHash } from "node:crypto";
import { closeSync, openSync, readdirSync, readFileSync, readSync, statSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";

// the page's functions of WASI: Node 20's own crash in a garbage collection while memory grows
const require = createRequire(new URL("../../web/package.json", import.meta.url));
const source = readFileSync(new URL("../../web/src/worker/wasi.ts", import.meta.url), "utf8");
const { code } = await require("esbuild").transform(source, { loader: "ts", format: "esm" });
const { wasi } = await import("data:text/javascript;base64," + Buffer.from(code).toString("base64"));

const folderOf = (path) =>
  new Map(
    readdirSync(path)
      .filter((name) => statSync(join(path, name)).isFile())
      .map((name) => [
        name,
        {
          size: statSync(join(path, name)).size,
          read(at, count) {
            const opened = openSync(join(path, name));
            const bytes = new Uint8Array(count);
            const received = readSync(opened, bytes, 0, count, at);
            closeSync(opened);
            return bytes.subarray(0, received);
          },
        },
      ]),
  );

const [file, list] = process.argv.slice(2);
const module = await WebAssembly.compile(readFileSync(file));
// struct plp_model_info of 32-bit programs
const kInfo_bytes = 312;

async function load([folder, scene, segmentation]) {
  const files = folderOf(folder);
  let palpate;
  const instance = await WebAssembly.instantiate(module, {
    wasi_snapshot_preview1: wasi(
      () => palpate.memory,
      (text) => (stderr = text),
      () => files,
    ),
    palpate: { send: () => {}, close: () => {}, progress: () => {} },
  });
  palpate = instance.exports;
  palpate._initialize();
  const bytes = () => new Uint8Array(palpate.memory.buffer);
  const view = () => new DataView(palpate.memory.buffer);
  const text = (value) => {
    if (value === null) return 0;
    const encoded = new TextEncoder().encode(value + "\0");
    const at = palpate.malloc(encoded.length);
    bytes().set(encoded, at);
    return at;
  };
  const problem = () => {
    const at = palpate.plp_last_error();
    return { problem: new TextDecoder().decode(bytes().slice(at, bytes().indexOf(0, at))) };
  };

  const out = palpate.malloc(8);
  if (palpate.plp_model_load(text(scene), text(segmentation), 0, out) !== 0) return problem();
  const model = view().getUint32(out, true);
  const info = palpate.malloc(kInfo_bytes);
  view().setUint32(info, kInfo_bytes, true);
  if (palpate.plp_model_info_get(model, info) !== 0) return problem();
  const integers = (at, count) => Array.from({ length: count }, (_, n) => view().getInt32(info + at + 4 * n, true));
  const numbers = (at, count) => Array.from({ length: count }, (_, n) => view().getFloat64(info + at + 8 * n, true));
  const dims = integers(20, 3);
  const count = dims[0] * dims[1] * dims[2];
  const sha = (at, size) => createHash("sha256").update(bytes().subarray(at, at + size)).digest("hex");
  const voxels = palpate.malloc(2 * count);
  if (palpate.plp_model_labels(model, voxels, count) !== 0) return problem();
  const hasScan = view().getUint32(info + 308, true) !== 0;
  if (hasScan && palpate.plp_model_scan(model, out, out + 4) !== 0) return problem();
  return {
    hash: view().getBigUint64(info + 8, true).toString(),
    dims,
    spacing: numbers(40, 3),
    direction: numbers(64, 9),
    origin: numbers(136, 3),
    labels: sha(voxels, 2 * count),
    scan: hasScan ? sha(view().getUint32(out, true), 4 * count) : null,
    memory_MiB: palpate.memory.buffer.byteLength / 2 ** 20,
  };
}

let stderr = ""; // last text of palpate, which explains a trap
const results = [];
for (const one of JSON.parse(readFileSync(list, "utf8"))) {
  const begun = performance.now();
  try {
    results.push(await load(one));
  } catch (error) {
    results.push({ trap: `${error}: ${stderr}` });
  }
  results.at(-1).seconds = (performance.now() - begun) / 1000;
}
console.log(JSON.stringify(results));
