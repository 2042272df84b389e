// State shared by all parts of the page: displayed data and display settings.

import type { HeldTool, Scene, State } from "../protocol/messages.js";
import { add, rotate, conjugate, length, turn, invert, type Affine, type Vec3 } from "../base/geometry.js";
import { keep, recall, recallScene } from "./kept.js";
import type { Near, NearStructure } from "../protocol/near.js";
import type { PlanStore } from "./plan_store.js";
import { nearestNoGo, toolParts, type Approach } from "./no_go.js";
import { looksOf, restored, type KeptLooks, type Look } from "./looks.js";
import { showsTheSame, type Volumes } from "../protocol/scene.js";
import type { DevicePose, Pose } from "../protocol/wire.js";
import { Flag } from "../protocol/wire.js";
import { words } from "../words/words.js";

export type Tool = "window" | "pan" | "ruler" | "angle" | "plan" | "touch";
/** Projection through a slab of thickness `mm`, centred on a section's plane. */
export interface Slab {
  kind: "none" | "mean" | "maximum" | "minimum";
  mm: number;
}
/** Intensity window, in values of the scan. */
export interface Window {
  level: number;
  width: number;
}

type Planes = Pick<Session, "follow" | "cross" | "obliqueNormal">;

/** Looks of a scene, as this browser stores them. */
export interface KeptScene {
  looks: KeptLooks;
}
export type Layout = "two" | "five" | "volume" | "section" | "inside" | "scope";
export const LAYOUTS: Layout[] = ["two", "five", "volume", "section", "inside", "scope"];
/**
 * Settings of the page for all scenes. The window of each modality is relative to the scan's initial window, except for
 * CT, whose values (HU) are comparable between scans.
 */
export interface KeptPage {
  layout: Layout;
  cards: Record<string, boolean>;
  sound: boolean;
  windows: Partial<Record<Scene["modality"], Window>>;
}
export const PAGE_KEY = "palpate.page";

const TRAIL_S = 2;
/** RGBA of a structure whose no-go region pushes a tool out. */
const LIT = [255, 107, 94, 255];
/** Flags of ticks in which the force is withheld or fades out. */
const WITHHELD = Flag.emergencyStop | Flag.paused | Flag.stale | Flag.deviceFault | Flag.halted | Flag.clutched;

/** Contact of a tip, and the text that describes it on the page. */
export interface Contact {
  label: number; // label in contact while its force is rendered; 0: none
  words: string;
}

export class Session {
  scene: Scene | null = null;
  volumes: Volumes | null = null;
  state: State | null = null;
  pose: Pose | null = null;
  isFresh = false;
  age_ms = Infinity;

  looks: Look[] = []; // indexed like the scene's structures
  window: Window = { level: 0, width: 1 };
  givenWindow: Window | null = null; // initial window of the scene; null once the user has changed it
  fill = 0.45;
  outlines = true;
  strain = false; // strain is displayed in sections
  yields = false; // some tissue is deformable
  movedAt: (place: Vec3) => Vec3 = () => [0, 0, 0]; // displacement of a position at rest, mm, as displayed
  slab: Slab = { kind: "none", mm: 10 };
  scanInVolume = 0;
  tool: Tool = "window";
  convention: "LPS" | "RAS" = "LPS";
  follow = true; // the planes follow the tip
  cross: Vec3 | null = null; // point of all planes while they do not follow
  obliqueNormal: Vec3 | null = null; // normal of the oblique plane from a bookmark, while it does not follow
  pointed: (() => Vec3 | null) | null = null; // position under the mouse, on the section as drawn when called
  holding = false; // a press on this page holds the tip
  /** Voxel values displayed with the look of value `as`, for a quiz; null: none. */
  alike: { values: number[]; as: number } | null = null;
  /** Labels to be found in a quiz, during which structures have no names; null: no quiz. */
  quiz: number[] | null = null;
  plans!: PlanStore; // plan to rehearse
  near: Near[] = []; // indexed by device number; empty: not reported
  /** No-go region with the deepest penetration by any tool, or else the nearest one; null: no distance is known. */
  approach: Approach | null = null;
  trail: { p: Vec3; time: number }[] = [];

  lookVersion = 0; // incremented when looks change
  version = 0; // incremented when anything on the page changes

  private patientFromWorld: Affine = [
    [1, 0, 0, 0],
    [0, 1, 0, 0],
    [0, 0, 1, 0],
    [0, 0, 0, 1],
  ];

  /** Position and orientation of the planes. */
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
      this.window = this.givenWindow = this.keptWindow() ?? {
        level: (low + high) / 2,
        width: Math.max(high - low, this.leastWindow),
      };
      this.cross = null;
      this.follow = true;
    }
    this.trail = [];
    this.touchLooks();
  }

  setPose(pose: Pose): void {
    this.pose = pose;
    const shown = this.toolAt(pose.devices[0]!);
    // a paused recording repeats its pose
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
    // the distance to a structure to be found would reveal its position
    const regions = this.scene.no_go.map((region) => (this.isHidden(region.label) ? null : region));
    let nearest: Approach | null = null;
    for (const device of pose.devices) {
      const near = this.near[device.number];
      if (!near) continue;
      const parts = toolParts(this.heldBy(device), device.tip, (v) =>
        this.toPatient(pose, rotate(device.orientation, v)),
      );
      const approach = nearestNoGo(regions, parts, near);
      if (approach && !(nearest && nearest.mm <= approach.mm)) nearest = approach;
    }
    return nearest;
  }
  private isHidden(label: number | null): boolean {
    return label !== null && this.quiz?.includes(label) === true;
  }
  /** Distances of a device's tool, except to structures to be found in a quiz. */
  nearTo(device: DevicePose): NearStructure[] {
    return (this.near[device.number]?.structures ?? []).filter(({ label }) => !this.isHidden(label));
  }
  /** No-go region that pushes a tool out; null: none. */
  get pushing(): Approach | null {
    return this.approach?.pushes ? this.approach : null;
  }
  /** Index of the structure whose no-go region pushes a tool out, which is highlighted; null: none. */
  private get lit(): number | null {
    const label = this.pushing && this.scene!.no_go[this.pushing.region]?.label;
    return label ? this.scene!.structures.findIndex((structure) => structure.label === label) : null;
  }
  regionName(place: number): string {
    return this.quiz ? words.someRegion : readable(this.scene!.no_go[place]!.name);
  }

  /** Displayed position of a tool, patient frame: in contact, on the deformed surface; else at the tip. */
  toolAt(device: DevicePose): Vec3 {
    if (!(device.flags & Flag.contact) || device.flags & Flag.inside) return device.tip;
    return add(device.proxy, this.movedAt(device.contacts[0]?.place ?? device.proxy));
  }
  /** Devices in drawing order: the first one on top. */
  get drawn(): DevicePose[] {
    return [...(this.pose?.devices ?? [])].reverse();
  }
  heldBy({ number }: DevicePose): HeldTool {
    return this.scene!.tools[number]!;
  }
  /** Direction in the patient frame of a direction in World, for the object's rotation in a pose. */
  toPatient(pose: Pose, world: Vec3): Vec3 {
    return turn(this.patientFromWorld, rotate(conjugate(pose.rotation), world));
  }
  /** Point that all planes contain; patient frame. */
  anchor(): Vec3 {
    const tip = this.pose?.devices[0]?.tip;
    if (this.follow && tip) return tip;
    return this.cross ?? tip ?? this.volumes?.centre ?? [0, 0, 0];
  }
  /** Minimum width of a window: a thousandth of the scan's quantization step, which may be far below 1. */
  get leastWindow(): number {
    return (this.scene?.volume.scan?.scale ?? 1) / 1000;
  }
  /** Offset and scale from a window as stored by the browser to values of this scan. */
  private windowUnit(): [number, number] {
    const [low, high] = this.scene?.volume.scan?.window ?? [0, 1];
    return this.scene?.modality === "ct" ? [0, 1] : [low, Math.max(high - low, this.leastWindow)];
  }
  private keptWindow(): Window | null {
    const kept = recall<KeptPage>(PAGE_KEY).windows?.[this.scene!.modality];
    const [begin, unit] = this.windowUnit();
    return kept && Number.isFinite(kept.level) && kept.width > 0
      ? { level: begin + unit * kept.level, width: Math.max(unit * kept.width, this.leastWindow) }
      : null;
  }
  keepWindow(): void {
    if (!this.scene) return;
    const [begin, unit] = this.windowUnit();
    const { level, width } = this.window;
    keep<KeptPage>(PAGE_KEY, {
      windows: {
        ...recall<KeptPage>(PAGE_KEY).windows,
        [this.scene.modality]: { level: (level - begin) / unit, width: width / unit },
      },
    });
  }
  /** Lower and upper end of the window, in stored (unscaled) values of the scan. */
  storedWindow(): [number, number] {
    const scan = this.scene?.volume.scan;
    const low = this.window.level - this.window.width / 2;
    return scan ? [(low - scan.offset) / scan.scale, (low + this.window.width - scan.offset) / scan.scale] : [0, 1];
  }
  /** Lookup table of 256 RGBA colours: 0 for no structure, then the structures in order; alpha is the opacity. */
  palette(): Uint8Array<ArrayBuffer> {
    const rgba = new Uint8Array(1024);
    this.looks
      .slice(0, 255)
      .forEach((look, place) =>
        rgba.set([...look.colour, look.visible ? Math.round(255 * look.opacity) : 0], (place + 1) * 4),
      );
    const { lit } = this;
    if (lit !== null && lit >= 0 && lit < 255) rgba.set(LIT, (lit + 1) * 4);
    for (const value of this.alike?.values ?? [])
      rgba.copyWithin(4 * value, 4 * this.alike!.as, 4 * this.alike!.as + 4);
    return rgba;
  }
  contactOf(device: DevicePose): Contact {
    const touches = device.label > 0;
    const isFelt = touches && !(device.flags & WITHHELD && length(device.force) === 0);
    // a tip that started inside a structure has no contact without being in free space
    const place = this.volumes?.structureAt(device.tip) ?? null;
    const around = place === null ? null : this.nameAt(place);
    const name = touches ? (this.structureName(device.label) ?? words.unnamed(String(device.label))) : around;
    if (name === null) return { label: 0, words: device.flags & Flag.outside ? words.outside : words.free };
    return isFelt
      ? { label: device.label, words: this.withEnclosing(readable(name), device.label) }
      : { label: 0, words: words.notFelt(readable(name)) };
  }
  /** Name of a structure by its index; anonymous in a quiz. */
  nameAt(place: number): string {
    return this.quiz ? words.someStructure : this.scene!.structures[place]!.name;
  }
  /** Name of a structure in contact, with the structures that enclose it. */
  private withEnclosing(name: string, label: number): string {
    const within = this.quiz
      ? []
      : (this.scene?.structures.find((structure) => structure.label === label)?.within ?? []);
    const names = within.map((larger) => readable(this.structureName(larger) ?? words.unnamed(String(larger))));
    return names.length > 0 ? words.within(name, names.join(", ")) : name;
  }
  structureName(label: number): string | null {
    if (this.quiz) return words.someStructure;
    return this.scene?.structures.find((structure) => structure.label === label)?.name ?? null;
  }
}

/** Display form of an identifier: "femoral cartilage" of "femoral_cartilage". */
export const readable = (name: string): string => name.replaceAll("_", " ");
