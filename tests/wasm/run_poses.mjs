// Runs poses through a session of palpate.wasm.
//
// usage: run_poses.mjs PALPATE.WASM SCENE POSES WRENCHES PASSES SOFT FOLDER
//
// A SCENE that is a file lies in FOLDER. POSES has structs plp_pose, WRENCHES gets as many plp_wrench. SOFT is 1 to
// solve deforming tissue in the ticks, else 0. Prints the seconds that the model took, the least processor time of the
// ticks in PASSES passes, and the hash of the run.

import { readFileSync, writeFileSync } from "node:fs";
import { WASI } from "node:wasi";

const [file, scene, posesFile, wrenchesFile, passes, soft, folder] = process.argv.slice(2);
const kPose_bytes = 80,
  kWrench_bytes = 56,
  kOptions_bytes = 80,
  kSolveSoftTissue = 28; // offset of plp_session_options::solve_soft_tissue
const wasi = new WASI({ version: "preview1", preopens: { "/": folder } });
const { instance } = await WebAssembly.instantiate(readFileSync(file), {
  ...wasi.getImportObject(),
  palpate: { send: () => {}, close: () => {}, progress: () => {} }, // of a session with a page
});
wasi.initialize(instance);
const palpate = instance.exports;

const bytes = () => new Uint8Array(palpate.memory.buffer);
const put = (data) => {
  const at = palpate.malloc(data.length);
  bytes().set(data, at);
  return at;
};
const pointer = () => put(new Uint8Array(8));
const read = (at) => new DataView(palpate.memory.buffer).getUint32(at, true);
const check = (status) => {
  if (status === 0) return;
  const at = palpate.plp_last_error();
  throw new Error(
    new TextDecoder().decode(bytes().subarray(at, bytes().indexOf(0, at))),
  );
};

const begun = performance.now();
const out = pointer();
check(
  palpate.plp_model_load(
    put(new TextEncoder().encode(scene + "\0")),
    0,
    0,
    out,
  ),
);
const model = read(out);
const made = performance.now();
const options = put(new Uint8Array(kOptions_bytes));
check(palpate.plp_session_options_init(options, kOptions_bytes));
new DataView(palpate.memory.buffer).setInt32(options + kSolveSoftTissue, Number(soft), true);
check(palpate.plp_session_create(model, options, out));
const session = read(out);

const input = readFileSync(posesFile);
const ticks = input.length / kPose_bytes;
const poses = put(input);
const output = new Uint8Array(ticks * kWrench_bytes);
const sizes = new DataView(output.buffer);
for (let n = 0; n < ticks; ++n)
  sizes.setUint32(n * kWrench_bytes, kWrench_bytes, true);
const wrenches = put(output);
// the least of several passes: the first ones are compiled meanwhile
let least_s = Infinity;
for (let pass = 0; pass < Number(passes); ++pass) {
  check(palpate.plp_session_reset(session));
  const began = process.cpuUsage();
  check(palpate.plp_session_run(session, poses, ticks, 1e-3, wrenches, 0));
  least_s = Math.min(least_s, process.cpuUsage(began).user / 1e6);
}
writeFileSync(wrenchesFile, bytes().slice(wrenches, wrenches + output.length));
const count = pointer(),
  hash = pointer();
check(palpate.plp_session_hash(session, count, hash));
console.log(
  JSON.stringify({
    model_s: (made - begun) / 1000,
    ticks_s: least_s,
    run_hash: new DataView(palpate.memory.buffer)
      .getBigUint64(hash, true)
      .toString(16),
    memory_MiB: palpate.memory.buffer.byteLength / 2 ** 20,
  }),
);
