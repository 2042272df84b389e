// Strokes over real scenes, felt by palpate: drags in the volume, in sections and in the scope, at 5 and 30 pictures a
// second.
//
//     node .test/test/stroke_campaign.js PALPATE DRAGS [SCENE ...]
//
// The requirements are those of docs/guide/viewer.md, "The pointer as the device". PALPATE_SEED repeats a seed.

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { createServer } from "node:net";
// @ts-expect-error ws has no type declarations
import { WebSocket as Socket } from "ws";
import {
  add,
  anatomicalPlane,
  cross,
  dot,
  length,
  normalize,
  scale,
  sub,
  tangents,
  type Vec3,
} from "../src/base/geometry.js";
import { Connection } from "../src/protocol/connection.js";
import { fetchScene, fetchVolumes } from "../src/protocol/scene.js";
import { Flag } from "../src/protocol/wire.js";
import { MAX_DISTANCE_MM, PointerDevice } from "../src/state/pointer.js";
import { Session } from "../src/state/session.js";
import { distanceFrom, SurfaceDrag, type SurfacePoint } from "../src/touch/surface_drag.js";
import { Touching } from "../src/touch/touching.js";
import { Camera } from "../src/volume/camera.js";
import { firstTouchable } from "../src/touch/surface.js";

type Position = [number, number];
type Kind = "volume" | "section" | "scope";

const [program, count, ...named] = process.argv.slice(2);
const SCENES = named.length > 0 ? named : ["knee-atlas", "knee-phantom", "palpation-block"];
const KINDS: Kind[] = ["volume", "section", "scope"];
const RATES_HZ = [5, 30];
const DRAG_S = 1.4;
/** Rate at which a browser records positions of the cursor. */
const EVENTS_HZ = 60;
/**
 * Time for which the tip may be on its way after the surface under the cursor has jumped by more than MAX_DISTANCE_MM,
 * has come back or faces the other side. The path of the cursor alone decides that, whatever the page does.
 */
const CROSSING_S = 0.2;
/** Cosine between two directions into a structure below which the cursor has come to the other side of a thin one. */
const OTHER_SIDE = -0.3;
/** Maximum number of times per drag that the page sets the tip down although the surface has not jumped. */
const MAX_SET_DOWNS = 0.25;
/** Maximum time for which the page shows that the tip is on its way, since the latest such jump. */
const MAX_TRANSFER_S = 0.3;
/** Picture of the camera and of the scope, CSS pixels. */
const SIZE = 600;

const seed = Number(process.env.PALPATE_SEED ?? Date.now() % 1e6);
let state = seed + 1;
const random = () => (state = (state * 48271) % 2147483647) / 2147483647;
const between = (a: number, b: number) => a + (b - a) * random();
const later = (ms: number) => new Promise((done) => setTimeout(done, ms));
async function until(what: string, isTrue: () => boolean, ms = 120_000): Promise<void> {
  for (const end = Date.now() + ms; !isTrue(); await later(5))
    assert.ok(Date.now() < end, `never became true: ${what}`);
}
const freePort = () =>
  new Promise<number>((done) => {
    const server = createServer().listen(0, "127.0.0.1", () => {
      const { port } = server.address() as { port: number };
      server.close(() => done(port));
    });
  });

/** Ticks without force because the loop had no processor, and the time in which the force returns after them. */
const HALTED = Flag.halted | Flag.jump | Flag.ramp;
const RAMP_MS = 150;
let resumed_ms = 0;
/** Delay of the page's timer, beyond its own work, from which on this machine has left the page no processor. */
const LATE_MS = 20;
/** Timer that measures this delay, as the pointer's own messages have it. */
class Punctuality {
  worst_ms = 0;
  private until_ms = 0;
  private last_ms = performance.now();
  private busy = process.cpuUsage();
  private readonly timer = setInterval(() => {
    const now_ms = performance.now();
    const busy = process.cpuUsage(this.busy);
    const late_ms = now_ms - this.last_ms - INTERVAL_MS - (busy.user + busy.system) / 1000;
    this.worst_ms = Math.max(this.worst_ms, late_ms);
    if (late_ms > LATE_MS) this.until_ms = now_ms + RAMP_MS;
    [this.last_ms, this.busy] = [now_ms, process.cpuUsage()];
  }, INTERVAL_MS);
  /** Whether the page has had no processor within the time in which a stroke recovers from it. */
  get isLate(): boolean {
    return performance.now() < this.until_ms || performance.now() - this.last_ms > LATE_MS + INTERVAL_MS;
  }
  end(): void {
    clearInterval(this.timer);
  }
}
const INTERVAL_MS = 8;

/** Figures of the samples of some drags. */
class Figures {
  samples = 0;
  touched = 0;
  forced = 0;
  drops = 0; // losses of force that neither the path of the cursor nor a tip set down by the page explains
  setDowns = 0; // tips set down where the path of the cursor does not explain it
  farthest_mm = 0; // largest distance in samples in which the page does not show that the tip is on its way
  crossing = 0; // samples within CROSSING_S of a jump of the surface, of which only the distance counts
  transferring = 0; // samples in which the page shows that the tip is on its way
  transfer_s = 0; // longest time for which it does
  unreached = 0;
  halted = 0; // samples while the machine left the loop no processor
  late = 0; // samples while it left the page none
  lateDrops = 0;
  add(other: Figures): void {
    for (const key of [
      "samples",
      "touched",
      "forced",
      "drops",
      "setDowns",
      "crossing",
      "transferring",
      "unreached",
      "halted",
      "late",
      "lateDrops",
    ] as const)
      this[key] += other[key];
    for (const key of ["farthest_mm", "transfer_s"] as const) this[key] = Math.max(this[key], other[key]);
  }
  get text(): string {
    const percent = (n: number) => `${((100 * n) / Math.max(1, this.samples)).toFixed(1)} %`;
    return (
      `${this.samples} samples: in contact ${percent(this.touched)}, force within 30 % ${percent(this.forced)}, ` +
      `farthest ${this.farthest_mm.toFixed(2)} mm, ${this.drops} drops, ${this.setDowns} set down, ` +
      `${this.unreached} drags without contact, ` +
      `${this.crossing} more at jumps of the surface, ${this.transferring} of all on the way, ` +
      `for at most ${this.transfer_s.toFixed(2)} s, ` +
      `${this.halted} more while the loop was halted, ${this.late} and ${this.lateDrops} drops while the page was`
    );
  }
}

/** Picture with a cursor. */
interface View {
  start: Position;
  pick(at: Position, stroke: SurfaceDrag): SurfacePoint | null;
  hover(at: Position, end: Vec3): Vec3;
  /** Next position of a cursor that moves in a direction, or along an outline; null: none. */
  next(at: Position, place: SurfacePoint | null, angle: number, mm: number): Position | null;
}

/** A scene with its session, as on a page. */
class Subject {
  private touching: Touching | null = null;
  readonly session = new Session();
  readonly pointer: PointerDevice;
  private readonly connection: Connection;
  readonly punctuality = new Punctuality();
  private setDown_ms = 0; // time of the latest message that sets the tip down
  private setDowns = 0; // number of those that the path of the cursor does not explain
  private jumped_ms = 0; // time at which the surface under the cursor has jumped, or the cursor has been on none
  private recorded: {
    at_ms: number;
    force_N: number;
    isExplained: boolean;
    isSetDown: boolean;
    isLate: boolean;
    isOnItsWay: boolean;
  }[] = [];

  constructor(readonly name: string) {
    const nothing = () => {};
    this.connection = new Connection(
      {
        onLink: nothing,
        onState: (received) => (this.session.state.value = received),
        onPose: (pose) => {
          this.session.setPose(pose);
          const { force, flags } = pose.devices[0]!;
          this.recorded.push({
            at_ms: performance.now(),
            force_N: length(force),
            isExplained: this.isCrossing || (flags & HALTED) !== 0,
            isSetDown: performance.now() - this.setDown_ms < 1000 * CROSSING_S,
            isLate: this.punctuality.isLate,
            isOnItsWay: this.touching?.stroke?.isTransferring === true,
          });
          if (flags & HALTED) resumed_ms = Date.now() + RAMP_MS;
        },
        onToken: nothing,
        onProblem: nothing,
        onOtherProtocol: nothing,
        onUnanswered: nothing,
        onAsked: nothing,
        onCut: nothing,
        onDeformation: () => (this.session.isDeformed.value = true),
        onTask: nothing,
        onDebriefing: nothing,
        onPlan: nothing,
        onNear: nothing,
        onTracked: nothing,
      },
      null,
    );
    const { setTipDown } = this.connection;
    this.connection.setTipDown = (at) => {
      if (!this.isCrossing) this.setDowns += 1;
      this.setDown_ms = performance.now();
      setTipDown.call(this.connection, at);
    };
    const always = { device: { value: true } };
    this.pointer = new PointerDevice(
      this.session,
      this.connection,
      always as never,
      {
        once: async (request: object) => (await this.connection.request(request as never)) === null,
      } as never,
    );
  }
  async open(): Promise<void> {
    const scene = await fetchScene(null);
    this.session.setScene(scene, await fetchVolumes(scene, 1, null, () => {}));
    this.connection.open();
    await until("a pose", () => this.session.pose.value !== null && this.session.state.value !== null);
    assert.equal(await this.connection.request({ type: "pointer", take: true }), null);
    await until("the pointer", () => this.session.state.value!.pointer);
  }
  close(): void {
    this.connection.end();
    this.punctuality.end();
  }

  /** Whether the tip may be on its way, because of the path of the cursor. */
  private get isCrossing(): boolean {
    return performance.now() - this.jumped_ms < 1000 * CROSSING_S;
  }

  /** Strokes once. */
  async drag(kind: Kind, rate_hz: number): Promise<Figures> {
    const { session, pointer } = this;
    const isTouchable = (p: Vec3) => touching.isTouchable(p);
    const view = this.viewFor(kind);
    const touching: Touching = new Touching(
      session,
      pointer,
      (at, stroke) => view.pick(at, stroke),
      (at, end) => view.hover(at, end),
      () => "",
    );
    this.touching = touching;
    const { cursors, places, jumps } = this.path(view, isTouchable, rate_hz);
    const figures = new Figures();
    if (cursors.length < 3) return figures;
    session.press_N.value = between(0.5, 1.2);
    const chosen_N = session.press_N.value;
    const event = { pointerType: "mouse", pressure: 0.5 } as PointerEvent;
    touching.press(event, cursors[0]!.at(-1)!);
    const device = () => session.pose.value!.devices[0]!;
    const touches = () =>
      (device().flags & (Flag.contact | Flag.inside)) === Flag.contact && length(device().force) > 0;
    const isThere = () => touches() && Math.abs(length(device().force) - chosen_N) < 0.3 * chosen_N;
    // the force of a new contact returns by a ramp
    const isRamped = () => (device().flags & Flag.ramp) === 0;
    for (const end = Date.now() + 3000; !(isThere() && isRamped()) && Date.now() < end;) await later(10);
    if (!isThere()) figures.unreached += 1;
    else {
      await later(100);
      this.recorded = [];
      this.setDowns = 0;
      for (let n = 1; n < cursors.length; n++) {
        // positions that the browser has recorded since the previous picture
        const passed = cursors[n]!.map((at) => ({ at }));
        touching.drag(
          { ...event, getCoalescedEvents: () => passed } as never,
          (each) => (each as unknown as { at: Position }).at,
        );
        const place = places[n];
        if (jumps[n] || !place) this.jumped_ms = performance.now();
        await later(1000 / rate_hz);
        if (!place) continue;
        if (device().flags & HALTED || Date.now() < resumed_ms) {
          figures.halted += 1;
          continue;
        }
        if (this.punctuality.isLate) {
          figures.late += 1;
          continue;
        }
        const tool_mm = session.toolOf(device()).radius_mm;
        const force_N = length(device().force);
        // from what the cursor shows; soft tissue is dented below it
        const contact_mm = session.isDeformed.value
          ? distanceFrom(place, { at: device().proxy, normal: device().normal })
          : length(sub(device().proxy, place.at));
        const far_mm = touches() ? Math.max(0, contact_mm - tool_mm) : 0;
        if (touching.stroke!.isTransferring) figures.transferring += 1;
        else figures.farthest_mm = Math.max(figures.farthest_mm, far_mm);
        const isForced = Math.abs(force_N - chosen_N) <= 0.3 * chosen_N;
        if (process.env.STROKE_VERBOSE && (!touches() || far_mm > 2 || !isForced))
          console.log(
            kind,
            rate_hz,
            n,
            `${force_N.toFixed(2)} of ${chosen_N.toFixed(2)} N, ${far_mm.toFixed(1)} mm, flags`,
            device().flags,
            "label",
            device().label,
            pointer.position?.into ? "presses" : "lifted",
            "tip",
            length(sub(device().tip, place.at)).toFixed(2),
          );
        if (this.isCrossing) {
          figures.crossing += 1;
          continue;
        }
        figures.samples += 1;
        figures.touched += touches() && far_mm <= MAX_DISTANCE_MM ? 1 : 0;
        figures.forced += isForced ? 1 : 0;
      }
      this.count(figures);
    }
    touching.release();
    await until("the release", () => length(device().force) === 0);
    return figures;
  }

  /** Counts the drops of the force, and how long the tip was on its way. */
  private count(figures: Figures): void {
    let wasDropped = false;
    let begun_ms = NaN;
    figures.setDowns = this.setDowns;
    for (const { at_ms, force_N, isExplained, isSetDown, isLate, isOnItsWay } of this.recorded) {
      const isDropped = force_N === 0 && !isExplained && !isSetDown;
      if (isDropped && !wasDropped) figures[isLate ? "lateDrops" : "drops"] += 1;
      wasDropped = isDropped;
      if (!isOnItsWay || isExplained || isLate) begun_ms = NaN;
      else if (Number.isNaN(begun_ms)) begun_ms = at_ms;
      else figures.transfer_s = Math.max(figures.transfer_s, (at_ms - begun_ms) / 1000);
    }
  }

  /** Cursor positions of a drag, and the surface point that each of them shows. */
  private path(
    view: View,
    isTouchable: (p: Vec3) => boolean,
    rate_hz: number,
  ): { cursors: Position[][]; places: (SurfacePoint | null)[]; jumps: boolean[] } {
    // finds surfaces, and remembers the latest one, like the stroke that is tested
    const finder = new SurfaceDrag(this.session.volumes.value!, isTouchable, [0, 0, 0], 0, () => [0, 0, 0]);
    const find = (at: Position) => (finder.point = view.pick(at, finder));
    const cursors: Position[][] = [];
    const places: (SurfacePoint | null)[] = [];
    const jumps: boolean[] = []; // whether the surface has jumped since the previous picture
    const turn = between(-1.5, 1.5); // rad/s
    const speed = between(20, 60); // mm/s on the picture
    const steps = Math.round(EVENTS_HZ / rate_hz);
    let at = view.start;
    let angle = between(0, 2 * Math.PI);
    let place = find(at);
    let hasJumped = false;
    let passed = [at];
    for (let n = 0; n <= DRAG_S * EVENTS_HZ; n++) {
      if (n % steps === 0) {
        cursors.push(passed);
        places.push(place);
        jumps.push(hasJumped);
        passed = [];
        hasJumped = false;
      }
      angle += turn / EVENTS_HZ;
      const next = view.next(at, place, angle, speed / EVENTS_HZ);
      if (!next) break;
      passed.push((at = next));
      const before = place;
      place = find(at);
      hasJumped ||=
        !place ||
        !before ||
        length(sub(place.at, before.at)) > MAX_DISTANCE_MM ||
        dot(place.into, before.into) < OTHER_SIDE;
    }
    return { cursors, places, jumps };
  }

  /** A picture that shows a random part of the scene, with a start on a surface. */
  private viewFor(kind: Kind): View {
    const { session } = this;
    const volumes = session.volumes.value!;
    const felt = (p: Vec3) => {
      const place = volumes.structureAt(p);
      return (
        place !== null &&
        session.scene.value!.tissues[session.scene.value!.structures[place]!.tissue]?.touchable === true
      );
    };
    for (;;) {
      let view: View;
      if (kind === "volume") {
        const camera = new Camera();
        camera.setWorldFromPatient(session.scene.value!.world_from_patient);
        camera.setRotation(session.pose.value!.rotation);
        camera.focus = camera.toWorld(volumes.centre);
        camera.mmPerPixel = volumes.size / SIZE;
        camera.orient("anterior");
        camera.orbit(between(-400, 400), between(-150, 150));
        view = {
          start: [between(-250, 250), between(-250, 250)],
          pick: (at, stroke) => stroke.surfaceAlong(camera.ray(...at)),
          hover: (at, end) => camera.unproject(...at, end),
          next: ([x, y], _, angle, mm) => [
            x + (mm / camera.mmPerPixel) * Math.cos(angle),
            y + (mm / camera.mmPerPixel) * Math.sin(angle),
          ],
        };
      } else {
        // a surface point of the scene, seen from the side from which a ray has met it
        const into = normalize([between(-1, 1), between(-1, 1), between(-1, 1)]);
        const [first, second] = tangents(into);
        const from = add(
          volumes.centre,
          add(scale(first, between(-0.3, 0.3) * volumes.size), scale(second, between(-0.3, 0.3) * volumes.size)),
        );
        const at = firstTouchable(volumes, felt, from, into);
        if (!at) continue;
        if (kind === "section") {
          const plane = anatomicalPlane((["axial", "sagittal", "coronal"] as const)[Math.floor(between(0, 3))]!, at);
          const pointOf = ([x, y]: Position) => add(at, add(scale(plane.right, x / 5), scale(plane.down, y / 5)));
          const normal = cross(plane.right, plane.down);
          view = {
            start: [0, 0],
            pick: (cursor, stroke) => stroke.outlineNear(pointOf(cursor), plane),
            hover: pointOf,
            // along the outline, half a millimetre inside
            next: (_, place, angle, mm) => {
              if (!place) return null;
              const inPlane = normalize(sub(place.into, scale(normal, dot(place.into, normal))));
              const along = scale(cross(normal, inPlane), Math.sin(angle) < 0 && angle < 0 ? -mm : mm);
              const p = sub(add(add(place.at, scale(inPlane, 0.5)), along), at);
              return [
                5 * (p[0] * plane.right[0] + p[1] * plane.right[1] + p[2] * plane.right[2]),
                5 * (p[0] * plane.down[0] + p[1] * plane.down[1] + p[2] * plane.down[2]),
              ];
            },
          };
        } else {
          const tangent = Math.tan((40 * Math.PI) / 180);
          const eye = sub(at, scale(into, between(8, 20)));
          const ray = ([x, y]: Position) => ({
            from: eye,
            into: normalize(
              add(into, add(scale(first, (x / SIZE) * 2 * tangent), scale(second, (y / SIZE) * 2 * tangent))),
            ),
          });
          view = {
            start: [0, 0],
            pick: (cursor, stroke) =>
              Math.hypot(...cursor) > SIZE / 2 ? null : stroke.surfaceAlong(ray(cursor), undefined, 0.5),
            hover: (cursor, end) => add(eye, scale(ray(cursor).into, length(sub(end, eye)))),
            // a third of the speed in the other pictures, whose fields are wider
            next: ([x, y], _, angle, mm) => {
              const pixels = (mm / 3 / length(sub(at, eye)) / (2 * tangent)) * SIZE;
              return [x + pixels * Math.cos(angle), y + pixels * Math.sin(angle)];
            },
          };
        }
      }
      if (view.pick(view.start, new SurfaceDrag(volumes, felt, [0, 0, 0], 0, () => [0, 0, 0]))) return view;
    }
  }
}

async function tryScene(name: string, drags: number, all: Figures): Promise<void> {
  const port = await freePort();
  const server = spawn(
    program!,
    ["explore", name, "--device", "pointer", "--port", String(port), "--no-realtime", "--no-supervisor"],
    { stdio: ["ignore", "ignore", "pipe"] },
  );
  let said = "";
  server.stderr.on("data", (text) => (said += text));
  const url = `http://127.0.0.1:${port}`;
  const fetchFromAnywhere = globalThis.fetch;
  Object.assign(globalThis, {
    location: { protocol: "http:", host: `127.0.0.1:${port}` },
    window: globalThis,
    document: { getElementById: () => ({}) },
    WebSocket: Socket,
    fetch: (path: string, more?: RequestInit) => fetchFromAnywhere(new URL(path, url), more),
  });
  try {
    for (let isUp = false; !isUp;) {
      assert.equal(server.exitCode, null, said);
      isUp = await fetch("/api/scene").then(
        ({ ok }) => ok,
        () => false,
      );
      if (!isUp) await later(200);
    }
    await Touching.load();
    const subject = new Subject(name);
    await subject.open();
    const kinds = KINDS.flatMap((kind) => RATES_HZ.map((rate_hz) => [kind, rate_hz] as const));
    const figures = new Map(kinds.map((one) => [one.join(), new Figures()]));
    for (let n = 0; n < drags; n++) {
      const [kind, rate_hz] = kinds[n % kinds.length]!;
      figures.get([kind, rate_hz].join())!.add(await subject.drag(kind, rate_hz));
    }
    for (const [of, its] of figures) {
      console.log(`  ${name}, ${of} Hz: ${its.text}`);
      all.add(its);
    }
    console.log(`  ${name}: the page's timer was up to ${subject.punctuality.worst_ms.toFixed(0)} ms late`);
    subject.close();
  } finally {
    globalThis.fetch = fetchFromAnywhere;
    server.kill("SIGTERM");
    await new Promise((done) => server.on("exit", done));
  }
}

console.log(`seed ${seed}`);
const all = new Figures();
for (const [n, name] of SCENES.entries()) await tryScene(name, Math.ceil((Number(count) - n) / SCENES.length), all);
console.log(all.text);
if (all.samples < 4 * Number(count)) {
  assert.ok(all.halted + all.late > all.samples, "too few samples");
  console.log("skipped: this machine leaves the loop or the page no processor");
  process.exit(77);
}
assert.ok(all.touched >= 0.95 * all.samples, "contact");
assert.ok(all.forced >= 0.95 * all.samples, "force");
assert.ok(all.farthest_mm <= MAX_DISTANCE_MM, "distance");
assert.equal(all.drops, 0, "drops");
assert.ok(all.setDowns <= MAX_SET_DOWNS * Number(count), "set down");
assert.ok(all.transfer_s <= MAX_TRANSFER_S, "transfer");
assert.ok(all.unreached <= 0.02 * Number(count), "presses without contact");
process.exit(0);
