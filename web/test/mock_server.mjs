// Mock of `palpate explore`, by docs/reference/viewer-protocol.md: serves the built page, a synthetic left knee and a
// moving tip. For development of the page, and for its tests without palpate.
//
//   npm run build && npm run mock -- [--port 8480] [--input script|pointer|device] [--token-file FILE] [--page dist]
//                                    [--scan knee|ramp|sphere] [--protocol 3] [--refuse STATUS] [--repeat 1]
//                                    [--hold no] [--shaft no] [--tool probe] [--burr ball] [--second no] [--yield no]
//                                    [--more 0] [--kept FOLDER] [--task no]
//
//   --token-file F  lines as of palpate's: role, token, and a learner's pseudonym
//   --protocol N    announced version of the protocol
//   --refuse STATUS HTTP status of all responses of /api/ and /ws
//   --scan ramp     unsigned 16-bit scan, most of whose values lie in 1/256 of the range, on a grid whose axes are
//                   permuted, mirrored and rotated
//   --scan sphere   a sphere of 20 mm in voxels of 0.5 mm
//   --shaft yes     tool with a shaft of 40 mm, as with --scan ramp
//   --tool burr     burr with a motor: each start cuts a stroke of 3 mm radius along a path of 2 mm, the first one from
//                   the centre of the first structure, each further one 7 mm above the previous one
//   --burr FORM     head of the burr; cylinder: 1 mm radius over a length of 6 mm; cone: from 1 to 2.5 mm radius
//   --second yes    second device with a ball of 4 mm radius on a shaft, at rest 20 mm left of the first one's start
//   --more N        N further structures without voxels
//   --repeat N      subdivision of each voxel into N^3; 2: 9.6 million in all, as many as a clinical scan of a knee has
//   --hold yes      volumes are withheld until a request of /mock/release
//   --yield yes     deformable tissue under the tip
//   --task yes      a task, whose runs nobody can begin
//   --kept FOLDER   cache of voxels, which saves a second at the next start
//
// /mock/stops lists the times of stops, in ms since 1970. /mock/yield?at=0,0,0&mm=1,0,0&wide=5&device=0 displaces the
// tissue around a position by a Gaussian of that width; /mock/yield without parameters ends the displacement.

import { createHash } from "node:crypto";
import { existsSync, readFileSync, renameSync, writeFileSync } from "node:fs";
import { createServer } from "node:http";
import { extname, join } from "node:path";
import { gzipSync } from "node:zlib";
import { WebSocketServer } from "ws";

const options = {
  port: "8480",
  input: "script",
  "token-file": "",
  page: new URL("../dist", import.meta.url).pathname,
  scan: "knee",
  protocol: "3",
  refuse: "",
  repeat: "1",
  more: "0",
  hold: "no",
  shaft: "no",
  tool: "probe",
  burr: "ball",
  second: "no",
  kept: "",
  yield: "no",
  task: "no",
};
for (let i = 2; i < process.argv.length; i += 2) options[process.argv[i].replace(/^--/, "")] = process.argv[i + 1];
const protocol = Number(options.protocol);
const tokens = new Map(
  options["token-file"]
    ? readFileSync(options["token-file"], "utf8")
        .split("\n")
        .filter(Boolean)
        .map((line) => line.split(" "))
        .map(([role, token, learner = null]) => [token, { role, learner }])
    : [],
);
// permissions by role: docs/reference/viewer-protocol.md
const rights = {
  view: ["look", "stop", "unseen"],
  control: ["look", "stop", "unseen", "hand", "feel", "plan", "play"],
  learner: ["look", "stop", "hand", "own_runs"],
  teacher: ["look", "stop", "unseen", "hand", "feel", "plan", "play", "lesson", "all_runs"],
};
const holderOf = (token) => (tokens.size === 0 ? { role: "control", learner: null } : (tokens.get(token) ?? null));
const whoIs = ({ role, learner }) => ({ role, learner, may: rights[role] });

// knee of simple shapes, mm from the joint; where shapes overlap, the first one counts
const length = (x, y, z) => Math.sqrt(x * x + y * y + z * z);
const ellipsoid = (c, r) => (p) => length((p[0] - c[0]) / r[0], (p[1] - c[1]) / r[1], (p[2] - c[2]) / r[2]) - 1;
const cylinder = (c, r, from, to) => (p) =>
  Math.max(length(p[0] - c[0], p[1] - c[1], 0) / r - 1, (from - p[2]) / r, (p[2] - to) / r);
const any =
  (...shapes) =>
  (p) =>
    shapes.reduce((least, shape) => Math.min(least, shape(p)), Infinity);
const ring = (c, r, thick) => (p) => length(length(p[0] - c[0], p[1] - c[1], 0) - r, p[2] - c[2], 0) / thick - 1;
const femur = any(
  ellipsoid([17, 4, 16], [16, 22, 16]),
  ellipsoid([-17, 4, 16], [16, 22, 16]),
  cylinder([0, 0, 0], 14, 18, 70),
);
const tibia = any(ellipsoid([0, 2, -16], [32, 21, 11]), cylinder([0, 0, 0], 13, -70, -16));
const structures = [
  { label: 1, name: "femur", colour: [240, 222, 190], tissue: 0, shape: femur },
  { label: 2, name: "tibia", colour: [226, 204, 160], tissue: 0, shape: tibia },
  { label: 3, name: "fibula", colour: [205, 176, 130], tissue: 0, shape: cylinder([36, 12, 0], 6, -70, -16) },
  { label: 4, name: "patella", colour: [250, 235, 205], tissue: 0, shape: ellipsoid([2, -30, 20], [14, 8, 15]) },
  {
    label: 5,
    name: "femoral_cartilage",
    colour: [96, 178, 214],
    tissue: 1,
    shape: any(ellipsoid([17, 4, 16], [18.5, 24.5, 18.5]), ellipsoid([-17, 4, 16], [18.5, 24.5, 18.5])),
  },
  { label: 6, name: "lateral_meniscus", colour: [214, 118, 96], tissue: 2, shape: ring([17, 2, -3.5], 12, 3.2) },
  { label: 7, name: "medial_meniscus", colour: [198, 92, 132], tissue: 2, shape: ring([-17, 2, -3.5], 12, 3.2) },
  {
    label: 8,
    name: "tibial_cartilage",
    colour: [120, 200, 150],
    tissue: 1,
    shape: ellipsoid([0, 2, -15], [33, 22, 12.4]),
  },
];
const more = Array.from({ length: Number(options.more) }, (_, n) => ({
  label: structures.length + n + 1,
  name: `structure_${n + 1}`,
  colour: [n, 128, 255 - n],
  tissue: n % 3,
}));
// cylindrical or conical head: vector from the ball at the tip to that at the far end, and the latter's radius
const HEAD = [0, 0, 6],
  END_RADIUS = options.burr === "cone" ? 2.5 : 1;
const isRamp = options.scan === "ramp";
const isSphere = options.scan === "sphere";
const dims = isRamp ? [60, 48, 44] : isSphere ? [52, 53, 54] : [100, 100, 120];
const spacing = isRamp ? 2.3 : isSphere ? 0.5 : 1.1;
if (isSphere)
  structures.forEach(
    (structure, n) => (structure.shape = n === 0 ? ellipsoid([0.1, -0.05, 0.15], [10, 10, 10]) : () => 1),
  );
// unit directions of i, j and k: the ramp's are permuted, mirrored and rotated by 12 degrees
const [cos, sin] = [Math.cos(0.21), Math.sin(0.21)];
const axes = isRamp
  ? [
      [0, sin, cos],
      [-1, 0, 0],
      [0, cos, -sin],
    ]
  : [
      [1, 0, 0],
      [0, 1, 0],
      [0, 0, 1],
    ];
const place = ([i, j, k]) => [0, 1, 2].map((r) => spacing * (axes[0][r] * i + axes[1][r] * j + axes[2][r] * k));
const origin = isRamp || isSphere ? place(dims.map((n) => (1 - n) / 2)) : [-54, -54, -65];
const X_PatientVoxel = [...[0, 1, 2].map((r) => [...axes.map((axis) => axis[r] * spacing), origin[r]]), [0, 0, 0, 1]];
const labels = new Uint8Array(dims[0] * dims[1] * dims[2]);
const scan = new Int16Array(labels.length);
const kept = options.kept && join(options.kept, `${options.scan}.voxels`);
if (kept && existsSync(kept)) {
  const bytes = readFileSync(kept);
  labels.set(bytes.subarray(0, labels.length));
  Buffer.from(scan.buffer).set(bytes.subarray(labels.length));
} else {
  let seed = 20;
  const random = () => (seed = (seed * 1103515245 + 12345) & 0x7fffffff) / 0x7fffffff;
  for (let k = 0, n = 0; k < dims[2]; k++) {
    for (let j = 0; j < dims[1]; j++) {
      for (let i = 0; i < dims[0]; i++, n++) {
        const p = place([i, j, k]).map((x, axis) => x + origin[axis]);
        const inside = structures.find((structure) => structure.shape(p) < 0);
        labels[n] = inside?.label ?? 0;
        const skin = length(p[0] / 52, (p[1] - 2) / 50, 0);
        const value = inside ? [600, 500, 110][inside.tissue] : skin < 0.82 ? 330 : skin < 1 ? 720 : 12;
        scan[n] = isRamp ? Math.round(1000 + (255 * i) / (dims[0] - 1)) - 32768 : value + 40 * (random() - 0.5);
      }
    }
  }
  if (isRamp) {
    scan[0] = -32768;
    scan[scan.length - 1] = 32767;
  }
  if (kept) {
    // atomic replacement, because several servers may start at once
    writeFileSync(`${kept}.${process.pid}`, Buffer.concat([labels, Buffer.from(scan.buffer)]));
    renameSync(`${kept}.${process.pid}`, kept);
  }
}
const hash = createHash("sha256").update(labels).update(scan).update(options.repeat).digest("hex").slice(0, 16);

// served voxels: those of the knee, subdivided `repeat` times along each axis
const repeat = Number(options.repeat);
const servedDims = dims.map((n) => n * repeat);
const X_PatientServed = X_PatientVoxel.map((row, r) =>
  r === 3 ? row : row.map((x, c) => (c === r ? x / repeat : c === 3 ? x - (row[r] / 2) * (1 - 1 / repeat) : x)),
);
function repeated(voxels) {
  if (repeat === 1) return voxels;
  const out = new voxels.constructor(voxels.length * repeat ** 3);
  const [nx, ny, nz] = servedDims;
  for (let k = 0, n = 0; k < nz; k++)
    for (let j = 0; j < ny; j++) {
      const row = dims[0] * (Math.floor(j / repeat) + dims[1] * Math.floor(k / repeat));
      for (let i = 0; i < nx; i++, n++) out[n] = voxels[row + Math.floor(i / repeat)];
    }
  return out;
}
const served = { scan: repeated(scan), labels: repeated(labels) };

const means = (voxels, shrink, kind) => {
  if (shrink === 1) return voxels;
  const dims = servedDims;
  const [nx, ny, nz] = dims.map((n) => Math.ceil(n / shrink));
  const out = new voxels.constructor(nx * ny * nz);
  for (let k = 0, n = 0; k < nz; k++)
    for (let j = 0; j < ny; j++)
      for (let i = 0; i < nx; i++, n++) {
        const block = [];
        for (let c = 0; c < shrink ** 3; c++) {
          const v = [
            i * shrink + (c % shrink),
            j * shrink + (Math.floor(c / shrink) % shrink),
            k * shrink + Math.floor(c / shrink / shrink),
          ];
          if (v.every((x, axis) => x < dims[axis])) block.push(voxels[v[0] + dims[0] * (v[1] + dims[1] * v[2])]);
        }
        if (kind === "scan") out[n] = Math.round(block.reduce((a, b) => a + b) / block.length);
        else {
          const counts = new Map();
          for (const label of block) counts.set(label, (counts.get(label) ?? 0) + 1);
          out[n] = [...counts].sort((a, b) => b[1] - a[1] || (a[0] || 1e9) - (b[0] || 1e9))[0][0];
        }
      }
  return out;
};

const feel = (stiffness_N_per_mm) => ({
  stiffness_N_per_mm,
  static_friction: 0.2,
  friction: 0.15,
  viscosity_N_s_per_mm: 0.001,
});
const tissues = [
  {
    name: "bone",
    touchable: true,
    protection: options.tool === "burr" ? "alarm" : "none",
    colour: [240, 222, 190],
    opacity: 1,
    ...feel(1.1),
    rests_on: [],
  },
  {
    name: "cartilage",
    touchable: true,
    protection: "none",
    colour: [96, 178, 214],
    opacity: 1,
    ...feel(0.8),
    rests_on: [0],
  },
  {
    name: "meniscus",
    touchable: true,
    protection: "none",
    colour: [214, 118, 96],
    opacity: 1,
    ...feel(0.5),
    rests_on: [1],
  },
];
const tool = {
  name: options.tool,
  radius_mm: 1,
  cuts: options.tool === "burr",
  burr: options.tool === "burr" ? options.burr : null,
  shaver: false,
  revolutions_per_s: options.tool === "burr" ? 1000 : 0,
  flutes: options.tool === "burr" ? 8 : 0,
  points_mm: [[0, 0, 0]],
  capsules:
    isRamp || options.shaft === "yes"
      ? [{ from_mm: [0, 0, 0], to_mm: [0, 0, 40], radius_mm: 3, end_radius_mm: 3 }]
      : options.tool === "burr" && options.burr !== "ball"
        ? [{ from_mm: [0, 0, 0], to_mm: HEAD, radius_mm: 1, end_radius_mm: END_RADIUS }]
        : [],
};
const second =
  options.second === "yes"
    ? [
        {
          name: "ball",
          radius_mm: 4,
          cuts: false,
          burr: null,
          points_mm: [[0, 0, 0]],
          capsules: [{ from_mm: [0, 0, 0], to_mm: [0, 0, 30], radius_mm: 2, end_radius_mm: 2 }],
          tip: [20, -52, 20],
        },
      ]
    : [];
const tasks = [
  {
    name: "probing",
    title: "Probing",
    briefing: "Touch the meniscus.",
    quiz: false,
    ordered: false,
    ends_with_steps: true,
    time_limit_s: null,
    answer_s: null,
    to_find: [],
    in_a_row: 1,
    scope: null,
    regions: [],
    steps: [],
    forces: [],
    protected: [],
    metrics: [],
  },
];
const scene = (holder) => ({
  protocol,
  palpate: "0.0.0-mock",
  ...whoIs(holder),
  side: "left",
  oriented: true,
  modality: "mr",
  volume: {
    hash,
    dims: servedDims,
    patient_from_voxel: X_PatientServed,
    scan: isRamp
      ? { scale: 1, offset: 32768, window: [1000, 1255], range: [0, 65535] }
      : { scale: 1, offset: 0, window: [12, 720], range: [-10, 745] },
    labels: { type: "uint8" },
  },
  // supine patient, viewed from the feet: World x to the patient's left, y superior, z anterior
  world_from_patient: [
    [1, 0, 0, 0],
    [0, 0, 1, 0],
    [0, -1, 0, 0],
    [0, 0, 0, 1],
  ],
  structures: [...structures.map(({ shape, ...seen }) => seen), ...more].map((seen) => ({ within: [], ...seen })),
  tissues: tissues.map((tissue, i) => ({ ...tissue, ...state.tissues[i] })),
  tool,
  tools: [tool, ...second.map(({ tip, ...held }) => held)],
  methods: ["proxy", "trilinear"],
  laws: ["elastic", "neo-hookean", "chainmail", "layers"],
  device: {
    name: options.input === "pointer" ? "pointer" : "simulated premium-1.5",
    simulated: options.input !== "device",
    input: options.input,
    peak_force_N: 8.5,
    continuous_force_N: 1.4,
    max_stiffness_N_per_mm: 1.1,
  },
  limits: {
    max_force_N: 1.4,
    min_max_force_N: 0.1,
    max_max_force_N: 1.4,
    stiffness_N_per_mm: [0.001, 10],
    static_friction: [0, 2],
    friction: [0, 2],
    viscosity_N_s_per_mm: [0, 0.1],
  },
  rate_hz: 1000,
  recording: null,
  tasks: options.task === "yes" ? tasks : [],
  distances: null,
  caveats: [{ concerns: "force", text: "tissues of 0.5 to 0.6 N/mm are felt as one where they touch" }],
  no_go: [],
});
const state = {
  method: "proxy",
  law: "elastic",
  law_awaited: null,
  law_failed: null,
  law_cells: cellsOf("elastic"),
  method_awaited: null,
  method_failed: null,
  friction: true,
  viscosity: true,
  passivity: true,
  paused: false,
  motor: false,
  vibration: false,
  motor_is_on: false,
  strokes: { undo: 0, redo: 0 },
  removed: [],
  broken_off_mm3: 0,
  nearest: [],
  emergency_stop: false,
  stop: null,
  max_force_N: 1.4,
  rotation_wxyz: [1, 0, 0, 0],
  model_version: 1,
  tissues: tissues.map(({ stiffness_N_per_mm, static_friction, friction, viscosity_N_s_per_mm }) => ({
    stiffness_N_per_mm,
    static_friction,
    friction,
    viscosity_N_s_per_mm,
  })),
  armed: options.input === "device",
  recording: false,
  playback: null,
};

// HTTP
const types = {
  ".html": "text/html; charset=utf-8",
  ".js": "text/javascript; charset=utf-8",
  ".css": "text/css; charset=utf-8",
  ".svg": "image/svg+xml",
};
let release = () => {};
const released = options.hold === "yes" ? new Promise((done) => (release = done)) : Promise.resolve();
const server = createServer((request, response) => {
  const { pathname, searchParams } = new URL(request.url, "http://localhost");
  const answer = (status, headers, body) => {
    response.writeHead(status, {
      "Content-Security-Policy":
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data: blob:; connect-src 'self'; " +
        "worker-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
      "X-Content-Type-Options": "nosniff",
      "Referrer-Policy": "no-referrer",
      "Cross-Origin-Resource-Policy": "same-origin",
      ...headers,
    });
    response.end(request.method === "HEAD" ? undefined : body);
  };
  if (pathname === "/" || /^\/assets\/[\w.]+$/.test(pathname)) {
    try {
      const file = pathname === "/" ? "index.html" : pathname.slice(1);
      return answer(
        200,
        { "Content-Type": types[extname(file)], "Cache-Control": "no-cache" },
        readFileSync(join(options.page, file)),
      );
    } catch {
      return answer(404, {}, "");
    }
  }
  if (pathname === "/mock/stops")
    return answer(200, { "Content-Type": "application/json", "Cache-Control": "no-store" }, JSON.stringify(stopsAt_ms));
  if (pathname === "/mock/yield") {
    const numbers = (name) => searchParams.get(name).split(",").map(Number);
    if (searchParams.has("at"))
      tellYield(numbers("device")[0], { at: numbers("at"), mm: numbers("mm"), wide: numbers("wide")[0] });
    else [...yields.keys()].forEach((device) => tellYield(device, null));
    return answer(200, {}, "");
  }
  if (pathname === "/mock/release") {
    release();
    return answer(200, {}, "");
  }
  const holder = holderOf((request.headers.authorization ?? "").replace(/^Bearer /, ""));
  if (options.refuse) return answer(Number(options.refuse), {}, "");
  if (!holder) return answer(401, {}, "");
  if (pathname === "/api/scene")
    return answer(
      200,
      { "Content-Type": "application/json", "Cache-Control": "no-store" },
      JSON.stringify(scene(holder)),
    );
  const kind = { [`/api/volume/scan/${hash}`]: "scan", [`/api/volume/labels/${hash}`]: "labels" }[pathname];
  if (!kind) return answer(404, {}, "");
  const voxels = means(served[kind], Number(searchParams.get("shrink") ?? 1), kind);
  const bytes = Buffer.from(voxels.buffer);
  const headers = {
    "Content-Type": "application/octet-stream",
    "Cache-Control": "private, max-age=31536000, immutable",
  };
  return void released.then(() =>
    kind === "labels"
      ? answer(200, { ...headers, "Content-Encoding": "gzip" }, gzipSync(bytes))
      : answer(200, headers, bytes),
  );
});

// tip: moved by a simulated hand from structure to structure, or by the pointer
const places = [
  [2, -40, 20],
  [17, -24, 4],
  [-17, -22, 2],
  [30, 8, -8],
  [-30, 6, -3.5],
  [0, -14, -40],
  [42, 12, -40],
  [5, -16, 55],
];
let tip = [0, -52, 20];
let before = tip;
let stops = 0;
let stopper = null; // viewer that requested the latest stop
const stopsAt_ms = [];
let pointer = null; // viewer that moves the tip
let asked_ms = -1e9;
let felt = [1, 0, 0, 0];
let tick = 0;
let sequence = 0;
const begun = performance.now();
const sub = (a, b) => a.map((x, i) => x - b[i]);
// scalars instead of arrays, because of 100 000 calls per second
const labelOf = (x, y, z) => {
  const [a, b, c] = [x - origin[0], y - origin[1], z - origin[2]];
  const along = (axis) => Math.round((axis[0] * a + axis[1] * b + axis[2] * c) / spacing);
  const [i, j, k] = [along(axes[0]), along(axes[1]), along(axes[2])];
  return i >= 0 && i < dims[0] && j >= 0 && j < dims[1] && k >= 0 && k < dims[2]
    ? labels[i + dims[0] * (j + dims[1] * k)]
    : 0;
};
const labelAt = (p) => labelOf(p[0], p[1], p[2]);
/** Approximate nearest surface from inside: exit with the shortest path among 120 directions, null beyond 40 mm. */
function surface(p) {
  let best = null;
  for (let i = 0; i < 120; i++) {
    const z = 1 - (2 * i + 1) / 120;
    const u = [Math.sqrt(1 - z * z) * Math.cos(2.4 * i), Math.sqrt(1 - z * z) * Math.sin(2.4 * i), z];
    for (let way = 0; way < (best?.way ?? 40); way += 0.2) {
      if (labelOf(p[0] + u[0] * way, p[1] + u[1] * way, p[2] + u[2] * way) === 0) {
        best = { way, q: p.map((x, c) => x + u[c] * way), u };
        break;
      }
    }
  }
  return best;
}
function hand(time) {
  const i = Math.floor(time / 2) % places.length;
  const share = Math.min(1, (time % 2) / 0.8);
  const ease = share * share * (3 - 2 * share);
  const from = places[(i + places.length - 1) % places.length];
  return from.map((x, c) => x + (places[i][c] - x) * ease);
}
// position of the tip at which a press has its force, at the stiffness of the structure behind the surface
function pressedAt({ patient_mm, into, force_N }) {
  const at = (depth) => patient_mm.map((x, c) => x + depth * into[c]);
  let begin = -3;
  while (begin < 3 && labelAt(at(begin)) === 0) begin += 0.05;
  const label = labelAt(at(begin));
  const stiffness = label ? Math.min(state.tissues[structures[label - 1].tissue].stiffness_N_per_mm, 1.1) : Infinity;
  return at(begin + force_N / stiffness);
}
function pose() {
  const time = (performance.now() - begun) / 1000;
  tick = Math.round(time * 1000);
  const stale = options.input === "pointer" && performance.now() - asked_ms > 560;
  if (options.input === "script") tip = hand(time);
  felt = felt.map((x, i) => x + 0.3 * (state.rotation_wxyz[i] - x));
  const norm = Math.hypot(...felt);
  felt = felt.map((x) => x / norm);
  const label = labelAt(tip);
  const out = label ? surface(tip) : null;
  const tissue = label ? structures[label - 1].tissue : -1;
  const stiffness = label ? Math.min(state.tissues[tissue].stiffness_N_per_mm, 1.1) : 0;
  const asked = out ? stiffness * out.way : 0;
  const limit = state.max_force_N;
  const off = state.paused || state.emergency_stop || stale;
  const force = off ? 0 : Math.min(asked, limit);
  // force in World (x, superior, anterior), rotated with the object
  const [w, x, y, z] = felt;
  const world = out ? [out.u[0], out.u[2], -out.u[1]].map((c) => c * force) : [0, 0, 0];
  const t = [y * world[2] - z * world[1], z * world[0] - x * world[2], x * world[1] - y * world[0]].map((c) => 2 * c);
  const turned = [
    world[0] + w * t[0] + y * t[2] - z * t[1],
    world[1] + w * t[1] + z * t[0] - x * t[2],
    world[2] + w * t[2] + x * t[1] - y * t[0],
  ];
  const speed = Math.hypot(...sub(tip, before)) * 60;
  before = tip;

  const bytes = Buffer.alloc(96 + 296 * (1 + second.length));
  bytes.write("PLPT", 0);
  bytes.writeUInt16LE(protocol, 4);
  bytes.writeUInt16LE(bytes.length, 6);
  bytes.writeBigUInt64LE(BigInt(++sequence), 8);
  bytes.writeBigUInt64LE(BigInt(tick), 16);
  bytes.writeDoubleLE(time, 24);
  bytes.writeBigUInt64LE(process.hrtime.bigint(), 32);
  bytes.writeUInt32LE(state.model_version, 40);
  bytes[44] = state.method === "proxy" ? 5 : 0;
  bytes[45] =
    (state.friction ? 1 : 0) |
    (state.viscosity ? 2 : 0) |
    (state.paused ? 4 : 0) |
    (state.emergency_stop ? 8 : 0) |
    (state.passivity ? 16 : 0);
  bytes[46] = 1 + second.length;
  const floats = (at, values) => values.forEach((value, i) => bytes.writeFloatLE(value, at + 4 * i));
  floats(48, felt);
  floats(64, [999.6 + Math.random(), 18 + 3 * Math.random(), 44 + 12 * Math.random(), 190, 0.8]);
  floats(96, [
    ...tip,
    ...(out?.q ?? tip),
    ...(out?.u ?? [0, 0, 0]),
    1,
    0,
    0,
    0,
    ...turned,
    asked,
    limit,
    0.09,
    out ? out.way : NaN,
    speed,
    off ? 0 : stiffness,
  ]);
  bytes.writeUInt32LE(
    (asked > limit ? 1 : 0) |
      (state.paused ? 8 : 0) |
      (label ? 16 : 0) |
      (stale ? 512 : 0) |
      (state.emergency_stop ? 8192 : 0),
    96 + 88,
  );
  bytes.writeUInt16LE(label, 96 + 96);
  if (label) {
    bytes.writeUInt16LE(label, 96 + 104);
    floats(96 + 108, [out ? out.way : NaN, 1]);
    bytes.writeUInt16LE(label, 96 + 176);
    floats(96 + 180, [...(out?.q ?? tip), asked]);
  }
  second.forEach((held, n) =>
    floats(96 + 296 * (n + 1), [...held.tip, ...held.tip, 0, 0, 0, 1, 0, 0, 0, 0, 0, 0, 0, limit, 0, NaN, 0, 0]),
  );
  return bytes;
}

// WebSocket
const sockets = new WebSocketServer({
  server,
  path: options.refuse ? "/none" : "/ws",
  perMessageDeflate: false,
  maxPayload: 4096,
  handleProtocols: (offered) => (offered.has("palpate.v1") ? "palpate.v1" : false),
});
const viewers = new Map();
// settings of the lesson that a teacher leads
const lesson = { learner: null, task: null, names: false, over: false };
const pageOf = (learner) => [...viewers].findLast(([, viewer]) => viewer.learner === learner)?.[0] ?? null;
const lessonFor = ({ role, learner }) => ({
  ...lesson,
  learner: role === "teacher" || learner === lesson.learner ? lesson.learner : null,
  of_another: role === "learner" && lesson.learner !== null && lesson.learner !== learner,
  redacted: false,
  learners:
    role === "teacher"
      ? [...tokens.values()]
          .filter((holder) => holder.role === "learner")
          .map((holder) => ({
            learner: holder.learner,
            here: pageOf(holder.learner) !== null,
            pointer: pointer !== null && viewers.get(pointer)?.learner === holder.learner,
          }))
      : null,
});
/** Changes the lesson; closes all connections if the session ends. */
function lead({ pointer: passedTo, end, ...values }) {
  if (values.learner === "") values.learner = null;
  Object.assign(lesson, values, end ? { over: true } : {});
  if (passedTo !== undefined) pointer = pageOf(passedTo);
  else if (values.learner) pointer = pageOf(values.learner);
  if (end) setTimeout(() => [...viewers.keys()].forEach((socket) => socket.close(1001)), 100);
}
const tellState = () => {
  for (const [socket, viewer] of viewers)
    socket.send(
      JSON.stringify({
        type: "state",
        ...state,
        stopped_by: state.stop === null ? null : stopper === socket ? "you" : "viewer",
        viewers: viewers.size,
        pointer: pointer === socket,
        pointer_by: pointer === null ? null : pointer === socket ? "you" : "viewer",
        lesson: lessonFor(viewer),
      }),
    );
};
function refusal(message, viewer) {
  if (message.type === "stop") return null;
  if (message.type === "lesson" && viewer.role !== "teacher") return { what: "Only a teacher leads a lesson." };
  if (message.pointer && pageOf(message.pointer) === null)
    return { what: "No page of that learner is connected.", where: "pointer" };
  if (message.type === "pointer" && message.take && pointer !== null && viewers.get(pointer) !== viewer)
    return { what: "Another viewer has the pointer.", where: "take" };
  if (message.type === "pointer" && lessonFor(viewer).of_another)
    return { what: "The lesson is led by another viewer now.", where: "learner" };
  if (viewer.role === "view") return { what: "This viewer may look, not change.", how: "Ask for a control token." };
  if (message.max_force_N > 1.4)
    return {
      what: "The force limit is above what the scene allows.",
      where: "max_force_N",
      how: "Ask for at most 1.4 N.",
    };
  if (
    message.type === "tissue" &&
    !(
      message.stiffness_N_per_mm === undefined ||
      (message.stiffness_N_per_mm >= 0.001 && message.stiffness_N_per_mm <= 10)
    )
  ) {
    return { what: "That stiffness is out of range.", where: "stiffness_N_per_mm", how: "0.001 to 10 N/mm." };
  }
  if (message.type === "rearm") {
    if (options.input === "device" && message.code !== "123456")
      return {
        what: "The code is not the one that is shown where palpate runs.",
        where: "code",
        how: "Enter the one that is shown now.",
      };
    if (message.stop !== state.stop)
      return {
        what: "There was another stop after the one that this answers.",
        where: "stop",
        how: "See why, and rearm again.",
      };
    if (labelAt(tip) !== 0 && options.input === "pointer")
      return { what: "The tip is in contact.", where: "", how: "Lead it to where it is free, then rearm." };
  }
  if (message.type === "undo" || message.type === "redo") {
    if (state.motor) return { what: "The burr's motor is on.", how: "Switch it off first." };
    if (state.strokes[message.type] === 0) return { what: `There is no stroke to ${message.type}.` };
  }
  if (message.type === "pointer" && options.input !== "pointer")
    return { what: "A simulated hand moves the tip.", where: "take", how: "Start palpate with --input pointer." };
  return null;
}
sockets.on("connection", (socket) => {
  socket.on("message", (data) => {
    const came_ms = performance.timeOrigin + performance.now();
    const message = JSON.parse(data);
    const viewer = viewers.get(socket);
    if (viewer && message.type === "stop") stopsAt_ms.push(came_ms);
    if (message.type === "hello") {
      if (message.protocol !== protocol) return socket.close(4406);
      const holder = holderOf(message.token ?? "");
      if (!holder) return socket.close(4401);
      viewers.set(socket, { ...holder, yielded: message.yielded === true });
      socket.send(JSON.stringify({ type: "welcome", ...whoIs(holder), protocol }));
      if (pointer === null && lesson.learner !== null && holder.learner === lesson.learner) pointer = socket;
      if (strokes.length > 0) socket.send(cutFrom(0));
      if (message.yielded) for (const { told, bytes } of yields.values()) if (told) socket.send(bytes);
      return tellState();
    }
    if (!viewer) return socket.close(1003);
    if (message.type === "tip") {
      if (pointer === socket) {
        tip = message.into ? pressedAt(message) : message.patient_mm;
        asked_ms = performance.now();
      }
      return undefined;
    }
    if (message.type === "lift") {
      if (pointer === socket) asked_ms = -Infinity;
      return undefined;
    }
    const { type, id, ...values } = message;
    const refused = refusal(message, viewer);
    if (refused) return socket.send(JSON.stringify({ type: "refused", id, ...refused }));
    // simulated confirmation at the device, after 1.5 s
    if (state.armed && ["set", "tissue", "undo", "redo"].includes(type)) {
      socket.send(JSON.stringify({ type: "asked", id }));
      setTimeout(() => grant(socket, type, id, values), 1500);
      return undefined;
    }
    return grant(socket, type, id, values);
  });
  const grant = (socket, type, id, values) => {
    if (type === "stop") {
      stopper = socket;
      Object.assign(state, { emergency_stop: true, stop: ++stops, armed: false });
    }
    if (type === "rearm")
      Object.assign(state, { emergency_stop: false, stop: null, armed: options.input === "device" });
    if (type === "pointer") pointer = values.take ? socket : null;
    if (type === "lesson") lead(values);
    if (type === "set" && values.motor && !state.motor) {
      undone.length = 0;
      changeStrokes(() => strokes.push(nextStroke()));
    }
    if (type === "set") {
      const { method = state.method_awaited ?? state.method, law = state.law_awaited ?? state.law, ...others } = values;
      Object.assign(state, others, "motor" in values ? { motor_is_on: values.motor } : {});
      choose(method);
      goBy(law);
    }
    if (type === "undo") changeStrokes(() => undone.push(strokes.pop()));
    if (type === "redo") changeStrokes(() => strokes.push(undone.pop()));
    if (type === "tissue") {
      const { tissue, ...feels } = values;
      Object.assign(state.tissues[tissue], feels);
      state.model_version += 1;
    }
    socket.send(JSON.stringify({ type: "done", id }));
    return tellState();
  };
  socket.on("close", () => {
    viewers.delete(socket);
    if (pointer === socket) pointer = null;
    tellState();
  });
});
/** Mean position of a label's voxels, patient frame, mm. */
function middle(label) {
  const sum = [0, 0, 0, 0];
  for (let n = 0; n < labels.length; n++) {
    if (labels[n] !== label) continue;
    [n % dims[0], Math.floor(n / dims[0]) % dims[1], Math.floor(n / (dims[0] * dims[1])), 1].forEach(
      (x, axis) => (sum[axis] += x),
    );
  }
  const mean = [...sum.slice(0, 3).map((x) => x / sum[3]), 1];
  return X_PatientVoxel.slice(0, 3).map((row) => row.reduce((all, x, axis) => all + x * mean[axis], 0));
}
// methods that are prepared; others take 0.5 s when they are first chosen
const ready = new Set(["proxy"]);
function choose(method) {
  if (ready.has(method)) return Object.assign(state, { method, method_awaited: null });
  if (state.method_awaited !== method)
    setTimeout(() => {
      ready.add(method);
      if (state.method_awaited === method) choose(method);
      tellState();
    }, 500);
  state.method_awaited = method;
}
// whether a constitutive law deforms tissue, and hence has surfaces of its own
const yieldsBy = (law) => law === "elastic" || law === "neo-hookean";
function cellsOf(law) {
  return law === "elastic" || law === "neo-hookean" ? { mm: law === "elastic" ? 1.25 : 1, requested_mm: 1 } : null;
}
function goBy(law) {
  if (yieldsBy(law) === yieldsBy(state.law))
    return Object.assign(state, { law, law_awaited: null, law_cells: cellsOf(law) });
  if (state.law_awaited !== law)
    setTimeout(() => {
      if (state.law_awaited !== law) return;
      Object.assign(state, { law, law_awaited: null, law_cells: cellsOf(law) });
      tellState();
    }, 500);
  state.law_awaited = law;
}
// sweeps of each stroke
const strokes = [];
const undone = [];
function nextStroke() {
  const [x, y, z] = middle(structures[0].label);
  const up = z + 7 * strokes.length;
  const head = options.burr === "ball" ? [3] : [1, ...HEAD, END_RADIUS];
  return [
    [x, y, up, x + 1, y, up, ...head],
    [x + 1, y, up, x + 2, y, up, ...head],
  ];
}
const cutFrom = (first) => JSON.stringify({ type: "cut", first, sweeps: strokes.flat().slice(first) });
/** Changes strokes, and reports sweeps from the first changed one on. */
function changeStrokes(change) {
  const before = strokes.flat().length;
  change();
  const told = cutFrom(Math.min(before, strokes.flat().length));
  for (const to of viewers.keys()) to.send(told);
  state.strokes = { undo: strokes.length, redo: undone.length };
  state.removed = strokes.length === 0 ? [] : [{ label: structures[0].label, mm3: 169.6 * strokes.length }];
  state.nearest =
    strokes.length === 0
      ? []
      : [
          { label: structures[0].label, mm: 0 },
          { label: structures[1].label, mm: 0.5 },
        ];
}
// latest deformation of each device
const yields = new Map();
function yieldMessage(device, told) {
  const spacing = 2.5,
    dims = told ? [24, 17, 17] : [0, 0, 0],
    first = dims.map((n, axis) => (told ? told.at[axis] - (spacing * (n - 1)) / 2 : 0));
  const bytes = Buffer.alloc(96 + 6 * dims[0] * dims[1] * dims[2]);
  bytes.write("PLPY", 0);
  bytes.writeUInt16LE(protocol, 4);
  bytes.writeUInt16LE(device, 6);
  bytes.writeUInt32LE(bytes.length, 8);
  bytes.writeUInt32LE(tick, 12);
  [...dims, 0, 0, 0, ...dims].forEach((count, n) => bytes.writeUInt16LE(count, 16 + 2 * n));
  [...first, 1, 0, 0, 0, 1, 0, 0, 0, 1, spacing, 0.001].forEach((x, n) => bytes.writeFloatLE(x, 36 + 4 * n));
  let at = 96;
  for (let k = 0; k < dims[2]; k++)
    for (let j = 0; j < dims[1]; j++)
      for (let i = 0; i < dims[0]; i++) {
        const share = Math.exp(
          -((length(...[i, j, k].map((n, axis) => first[axis] + spacing * n - told.at[axis])) / told.wide) ** 2) / 2,
        );
        for (const mm of told.mm) at = bytes.writeInt16LE(Math.round(1000 * share * mm), at);
      }
  return bytes;
}
function tellYield(device, told) {
  if (!told && !yields.get(device)?.told) return;
  const bytes = yieldMessage(device, told);
  yields.set(device, { told, bytes });
  for (const [socket, viewer] of viewers) if (viewer.yielded && socket.bufferedAmount < 1e5) socket.send(bytes);
}
if (options.yield === "yes") {
  setInterval(() => {
    const out = labelAt(tip) ? surface(tip) : null;
    tellYield(0, out && { at: out.q, mm: out.u.map((x) => -Math.min(3, out.way) * x), wide: 5 });
  }, 1000 / 15);
}
setInterval(() => {
  const bytes = pose();
  for (const socket of viewers.keys()) if (socket.bufferedAmount < 1e4) socket.send(bytes);
}, 1000 / 60);

// ends the server with the test process that started it, even after a crash of the latter
process.on("disconnect", () => process.exit());
server.listen(Number(options.port), "127.0.0.1", () => console.log(`http://127.0.0.1:${server.address().port}/`));
