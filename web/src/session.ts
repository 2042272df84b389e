// What the page shows and how: the one place where the parts of the page meet.

import { add, rotate, conjugate, length, turn, invert, type Affine, type Vec3 } from "./geometry.js";
import type { Bookmark } from "./bookmarks.js";
import { keep, recall, recallScene } from "./kept.js";
import type { Near, NearStructure } from "./near.js";
import type { PlanStore } from "./plan_store.js";
import { nearestNoGo, toolParts, type Approach } from "./no_go.js";
import { looksOf, restored, type KeptLooks } from "./looks.js";
import { showsTheSame, type HeldTool, type Rgb, type Scene, type State, type Volumes } from "./scene.js";
import type { DevicePose, Pose } from "./wire.js";
import { Flag } from "./wire.js";
import { words } from "./words.js";

export type Tool = "window" | "pan" | "ruler" | "angle" | "plan" | "touch";
export interface Look { colour: Rgb; opacity: number; visible: boolean }
/** Of a section: what is shown of all that lies so near to its plane. */
export interface Slab { kind: "none" | "mean" | "maximum" | "minimum"; mm: number }
export interface Window { level: number; width: number } // of the scan's values

type Planes = Pick<Session, "follow" | "cross" | "obliqueNormal">;

/** What this browser keeps of a scene. */
export interface KeptScene { looks: KeptLooks; bookmarks: Bookmark[] }
export type Layout = "two" | "five" | "volume" | "section" | "inside" | "scope";
export const LAYOUTS: Layout[] = ["two", "five", "volume", "section", "inside", "scope"];
/** And of the page, whatever it shows: the window of each modality, in parts of the scan's own but for CT, whose values are the same in every scan. */
export interface KeptPage { layout: Layout; cards: Record<string, boolean>; sound: boolean; windows: Partial<Record<Scene["modality"], Window>> }
export const PAGE_KEY = "palpate.page";

const TRAIL_S = 2;
/** Red, green, blue and opacity of what pushes a tool out. */
const LIT = [255, 107, 94, 255];
/** While one of these holds, the force is withheld or fades to nothing. */
const WITHHELD = Flag.emergencyStop | Flag.paused | Flag.stale | Flag.deviceFault | Flag.halted | Flag.clutched;

/** What the tip is at, and whether that is felt: what every part of the page says of it comes from here. */
export interface Contact {
  label: number; // of what is felt; 0: nothing is
  words: string;
}

export class Session {
  scene: Scene | null = null;
  volumes: Volumes | null = null;
  state: State | null = null;
  pose: Pose | null = null;
  isFresh = false;
  age_ms = Infinity;

  looks: Look[] = []; // of the structures in their order
  window: Window = { level: 0, width: 1 };
  givenWindow: Window | null = null; // with the scene: nobody has chosen it
  fill = 0.45;
  outlines = true;
  strain = false; // colours of how much tissue is strained
  yields = false; // some tissue does
  movedAt: (place: Vec3) => Vec3 = () => [0, 0, 0]; // how far tissue is drawn from where it lies at rest
  slab: Slab = { kind: "none", mm: 10 };
  scanInVolume = 0;
  tool: Tool = "window";
  convention: "LPS" | "RAS" = "LPS";
  follow = true; // the planes go through the tip
  cross: Vec3 | null = null; // where they go through otherwise
  obliqueNormal: Vec3 | null = null; // that the oblique one was called back with, while they rest
  pointed: (() => Vec3 | null) | null = null; // the point under the mouse, of the plane that is drawn when it is asked
  holding = false; // this page moves the tip just now
  /** Structures, by the values of voxels, that look as another one does. */
  alike: { values: number[]; as: number } | null = null;
  /** Labels of structures that are to be found in a quiz, in which no structure has a name; null: there is none. */
  quiz: number[] | null = null;
  plans!: PlanStore; // what is rehearsed
  near: Near[] = []; // of each device; none where nothing is told
  /** To the no-go region that any tool is deepest in or else nearest to; null: to none. */
  approach: Approach | null = null;
  trail: { p: Vec3; time: number }[] = [];

  lookVersion = 0; // another one: structures look otherwise
  version = 0; // another one: something on the page has changed

  private patientFromWorld: Affine = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];

  /** Where the planes are. */
  get planes(): Planes {
    const { follow, cross, obliqueNormal } = this;
    return { follow, cross, obliqueNormal };
  }
  set planes({ follow, cross, obliqueNormal }: Planes) {
    Object.assign(this, { follow, cross, obliqueNormal });
    this.touch();
  }

  touch(): void {
    this.version += 1;
  }
  touchLooks(): void {
    this.lookVersion += 1;
    this.touch();
  }

  setScene(scene: Scene, volumes: Volumes): void {
    const isNew = !showsTheSame(scene, this.scene);
    this.scene = scene;
    this.volumes = volumes;
    this.patientFromWorld = invert(scene.world_from_patient);
    if (isNew || this.looks.length !== scene.structures.length) {
      this.looks = restored(scene, looksOf(scene), recallScene<KeptScene>(scene.volume.hash).looks ?? {});
      const [low, high] = scene.volume.scan?.window ?? [0, 1];
      this.window = this.givenWindow = this.keptWindow() ?? { level: (low + high) / 2, width: Math.max(high - low, this.leastWindow) };
      this.cross = null;
      this.follow = true;
    }
    this.trail = [];
    this.touchLooks();
  }

  setPose(pose: Pose): void {
    this.pose = pose;
    const shown = this.toolAt(pose.devices[0]!);
    // a recording that rests says the same again and again
    if (this.trail.at(-1)?.time === pose.time) this.trail.pop();
    this.trail.push({ p: shown, time: pose.time });
    while (this.trail.length > 0 && this.trail[0]!.time < pose.time - TRAIL_S) this.trail.shift();
    if (this.trail.length > 1 && this.trail.at(-2)!.time > pose.time) this.trail = [];
    const lit = this.lit;
    this.approach = this.approachOf(pose);
    if (lit !== this.lit) this.touchLooks();
    this.touch();
  }

  private approachOf(pose: Pose): Approach | null {
    if (!this.scene) return null;
    // how near what is to be found is would tell where it is
    const regions = this.scene.no_go.map((region) => (this.isHidden(region.label) ? null : region));
    let nearest: Approach | null = null;
    for (const device of pose.devices) {
      const near = this.near[device.number];
      if (!near) continue;
      const parts = toolParts(this.heldBy(device), device.tip, (v) => this.toPatient(pose, rotate(device.orientation, v)));
      const approach = nearestNoGo(regions, parts, near);
      if (approach && !(nearest && nearest.mm <= approach.mm)) nearest = approach;
    }
    return nearest;
  }
  private isHidden(label: number | null): boolean {
    return label !== null && this.quiz?.includes(label) === true;
  }
  /** What is near a device's tool and may be told. */
  nearTo(device: DevicePose): NearStructure[] {
    return (this.near[device.number]?.structures ?? []).filter(({ label }) => !this.isHidden(label));
  }
  /** The region that pushes a tool out. */
  get pushing(): Approach | null {
    return this.approach?.pushes ? this.approach : null;
  }
  /** The structure that is to be seen at once, for it pushes: its place in the scene's list. */
  private get lit(): number | null {
    const label = this.pushing && this.scene!.no_go[this.pushing.region]?.label;
    return label ? this.scene!.structures.findIndex((structure) => structure.label === label) : null;
  }
  regionName(place: number): string {
    return this.quiz ? words.someRegion : readable(this.scene!.no_go[place]!.name);
  }

  /** Where the tool is drawn: held at the surface while it touches, and in its dent where the surface yields. */
  toolAt(device: DevicePose): Vec3 {
    if (!(device.flags & Flag.contact) || device.flags & Flag.inside) return device.tip;
    return add(device.proxy, this.movedAt(device.contacts[0]?.place ?? device.proxy));
  }
  /** The devices of the pose as they are drawn: the first one over the others. */
  get drawn(): DevicePose[] {
    return [...(this.pose?.devices ?? [])].reverse();
  }
  /** What a device holds. */
  heldBy({ number }: DevicePose): HeldTool {
    return this.scene!.tools[number]!;
  }
  /** What the pose says of World, in the patient as the object stands in that pose. */
  toPatient(pose: Pose, world: Vec3): Vec3 {
    return turn(this.patientFromWorld, rotate(conjugate(pose.rotation), world));
  }
  /** Where the planes go through. */
  anchor(): Vec3 {
    const tip = this.pose?.devices[0]?.tip;
    if (this.follow && tip) return tip;
    return this.cross ?? tip ?? this.volumes?.centre ?? [0, 0, 0];
  }
  /** The least width of a window: a thousandth of a step of the scan's values, which may be far smaller than 1. */
  get leastWindow(): number {
    return (this.scene?.volume.scan?.scale ?? 1) / 1000;
  }
  /** Where a window that is kept begins for this scan, and how wide one is. */
  private windowUnit(): [number, number] {
    const [low, high] = this.scene?.volume.scan?.window ?? [0, 1];
    return this.scene?.modality === "ct" ? [0, 1] : [low, Math.max(high - low, this.leastWindow)];
  }
  private keptWindow(): Window | null {
    const kept = recall<KeptPage>(PAGE_KEY).windows?.[this.scene!.modality];
    const [begin, unit] = this.windowUnit();
    return kept && Number.isFinite(kept.level) && kept.width > 0 ? { level: begin + unit * kept.level, width: Math.max(unit * kept.width, this.leastWindow) } : null;
  }
  keepWindow(): void {
    if (!this.scene) return;
    const [begin, unit] = this.windowUnit();
    const { level, width } = this.window;
    keep<KeptPage>(PAGE_KEY, { windows: { ...recall<KeptPage>(PAGE_KEY).windows, [this.scene.modality]: { level: (level - begin) / unit, width: width / unit } } });
  }
  /** In stored values of the scan. */
  storedWindow(): [number, number] {
    const scan = this.scene?.volume.scan;
    const low = this.window.level - this.window.width / 2;
    return scan ? [(low - scan.offset) / scan.scale, (low + this.window.width - scan.offset) / scan.scale] : [0, 1];
  }
  /** 256 colours: 0 nothing, then the structures in their order; alpha: opacity. */
  palette(): Uint8Array<ArrayBuffer> {
    const rgba = new Uint8Array(1024);
    this.looks.slice(0, 255).forEach((look, place) =>
      rgba.set([...look.colour, look.visible ? Math.round(255 * look.opacity) : 0], (place + 1) * 4));
    const { lit } = this;
    if (lit !== null && lit >= 0 && lit < 255) rgba.set(LIT, (lit + 1) * 4);
    for (const value of this.alike?.values ?? []) rgba.copyWithin(4 * value, 4 * this.alike!.as, 4 * this.alike!.as + 4);
    return rgba;
  }
  contactOf(device: DevicePose): Contact {
    const touches = device.label > 0;
    const isFelt = touches && !(device.flags & WITHHELD && length(device.force) === 0);
    // a tip that is in something since before it could be held at its surface feels nothing, and is not free either
    const place = this.volumes?.structureAt(device.tip) ?? null;
    const around = place === null ? null : this.nameAt(place);
    const name = touches ? this.structureName(device.label) ?? words.unnamed(String(device.label)) : around;
    if (name === null) return { label: 0, words: device.flags & Flag.outside ? words.outside : words.free };
    return isFelt ? { label: device.label, words: this.withEnclosing(readable(name), device.label) } : { label: 0, words: words.notFelt(readable(name)) };
  }
  /** Of the structure at a place of the scene's list. */
  nameAt(place: number): string {
    return this.quiz ? words.someStructure : this.scene!.structures[place]!.name;
  }
  /** The name of a structure that is touched, with those in which it is nested. */
  private withEnclosing(name: string, label: number): string {
    const within = this.quiz ? [] : this.scene?.structures.find((structure) => structure.label === label)?.within ?? [];
    const names = within.map((larger) => readable(this.structureName(larger) ?? words.unnamed(String(larger))));
    return names.length > 0 ? words.within(name, names.join(", ")) : name;
  }
  structureName(label: number): string | null {
    if (this.quiz) return words.someStructure;
    return this.scene?.structures.find((structure) => structure.label === label)?.name ?? null;
  }
}

/** "femoral_cartilage" for people. */
export const readable = (name: string): string => name.replaceAll("_", " ");
