// State shared by all parts of the page, as signals: what palpate reports, how it is displayed, and values
// derived from both. Panels and pictures subscribe to it.

import { batch, computed, effect, signal, untracked, type Signal } from "@preact/signals-core";
import type { Debriefing, DeviceTool, Scene, State, TaskProgress, Tracked } from "../protocol/messages.js";
import { add, rotate, conjugate, length, turn, invert, type Affine, type Vec3 } from "../base/geometry.js";
import { store, recall, recallScene } from "./local_storage.js";
import type { DeviceDistances, StructureDistance } from "../protocol/distances.js";
import type { PlanStore } from "./plan_store.js";
import { nearestNoGo, toolParts, type Approach } from "./no_go.js";
import { glossOf, appearancesOf, restored, type StoredAppearances, type Appearance } from "./appearance.js";
import { REMOVED, showsTheSame, type Volumes } from "../protocol/scene.js";
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
/** Position and orientation of the planes. */
export interface Planes {
  follow: boolean; // the planes follow the tip
  cross: Vec3 | null; // point of all planes while they do not follow
  obliqueNormal: Vec3 | null; // normal of the oblique plane from a bookmark, while it does not follow
}

/** Appearance of a scene, as this browser stores them. */
export interface StoredScene {
  looks: StoredAppearances;
}
export type Layout = "two" | "five" | "volume" | "section" | "inside" | "scope";
export const LAYOUTS: Layout[] = ["two", "five", "volume", "section", "inside", "scope"];
/**
 * Settings of the page for all scenes. The window of each modality is relative to the scan's initial window, except for
 * CT, whose values (HU) are comparable between scans.
 */
export interface StoredPage {
  layout: Layout;
  cards: Record<string, boolean>;
  sound: boolean;
  windows: Partial<Record<Scene["modality"], Window>>;
}
export const PAGE_KEY = "palpate.page";

const TRAIL_S = 2;
/** Highlight colour (RGBA) of a structure whose no-go region pushes a tool out. */
const HIGHLIGHT_RGBA = [255, 107, 94, 255];
/** RGBA of voxels that a burr has removed, in sections. */
const REMOVED_RGBA = [178, 62, 98, 255];
/** Flags of ticks in which the force is withheld or fades out. */
const WITHHELD = Flag.emergencyStop | Flag.paused | Flag.stale | Flag.deviceFault | Flag.halted | Flag.clutched;

/** Contact of a tip, and the text that describes it on the page. */
export interface Contact {
  label: number; // label in contact while its force is rendered; 0: none
  words: string;
}

export class Session {
  // ---- reported by palpate

  readonly scene = signal<Scene | null>(null);
  readonly volumes = signal<Volumes | null>(null);
  readonly state = signal<State | null>(null);
  readonly pose = signal<Pose | null>(null);
  readonly isFresh = signal(false);
  readonly age_ms = signal(Infinity);
  readonly near = signal<DeviceDistances[]>([]); // indexed by device number; empty: not reported
  readonly tracked = signal<Tracked | null>(null); // registration error of a tracked tool; null: no such tool
  readonly run = signal<TaskProgress | null>(null); // progress of the latest run of a task
  readonly debriefing = signal<Debriefing | null>(null); // results of the latest run

  // ---- display

  readonly appearances = signal<Appearance[]>([]); // indexed like the scene's structures
  readonly window = signal<Window>({ level: 0, width: 1 });
  readonly fill = signal(0.45);
  readonly outlines = signal(true);
  readonly strain = signal(false); // strain is displayed in sections
  readonly isDeformed = signal(false); // some tissue is deformed
  /** Displacement of a position at rest, mm, as displayed. */
  readonly displacementAt = signal<(position: Vec3) => Vec3>(() => [0, 0, 0]);
  readonly slab = signal<Slab>({ kind: "none", mm: 10 });
  readonly scanInVolume = signal(0);
  readonly layout = signal<Layout>("two");
  readonly tool = signal<Tool>("window");
  readonly convention = signal<"LPS" | "RAS">("LPS");
  readonly planes = signal<Planes>({ follow: true, cross: null, obliqueNormal: null });
  /** Returns the position under the mouse, on the section as drawn when called; null: the mouse is on no section. */
  readonly pointed = signal<(() => Vec3 | null) | null>(null);
  readonly isPressing = signal(false); // a press on this page controls the tip
  readonly isTransferring = signal(false); // the contact of that tip is not yet where the cursor shows
  readonly press_N = signal(1); // force with which a press touches a surface
  /** Voxel values displayed with the appearance of value `as`, to conceal them in a quiz; null: none. */
  readonly concealment = signal<{ values: number[]; as: number } | null>(null);
  /** Labels to be found in a quiz, during which structures have no names; null: no quiz. */
  readonly quiz = signal<number[] | null>(null);
  /** Number of changes of displayed voxels and their deformation. */
  readonly edits = signal(0);
  plans!: PlanStore; // plan to rehearse
  trail: { p: Vec3; time: number }[] = []; // recent positions of the first tool; changes with `pose`
  private baseWindow: Window | null = null; // initial window of the scene, or the one stored latest
  private readonly figures_ms = signal(-Infinity);

  // ---- derived

  private readonly patientFromWorld = computed<Affine>(() => {
    const scene = this.scene.value;
    return scene
      ? invert(scene.world_from_patient)
      : [
          [1, 0, 0, 0],
          [0, 1, 0, 0],
          [0, 0, 1, 0],
          [0, 0, 0, 1],
        ];
  });
  /** No-go region with the deepest penetration by any tool, or else the nearest one; null: no distance is known. */
  readonly approach = computed<Approach | null>(() => {
    const [scene, pose] = [this.scene.value, this.pose.value];
    if (!scene || !pose) return null;
    // the distance to a structure to be found would reveal its position
    const regions = scene.no_go.map((region) => (this.isHidden(region.label) ? null : region));
    let nearest: Approach | null = null;
    for (const device of pose.devices) {
      const near = this.near.value[device.number];
      if (!near) continue;
      const parts = toolParts(this.toolOf(device), device.tip, (v) =>
        this.toPatient(pose, rotate(device.orientation, v)),
      );
      const approach = nearestNoGo(regions, parts, near);
      if (approach && !(nearest && nearest.mm <= approach.mm)) nearest = approach;
    }
    return nearest;
  });
  /** No-go region that pushes a tool out; null: none. */
  readonly pushing = computed(() => (this.approach.value?.pushes ? this.approach.value : null));
  /** Index of the structure whose no-go region pushes a tool out, which is highlighted; null: none. */
  private readonly highlighted = computed(() => {
    const [scene, pushing] = [this.scene.value, this.pushing.value];
    const label = pushing && scene?.no_go[pushing.region]?.label;
    return label ? scene!.structures.findIndex((structure) => structure.label === label) : null;
  });
  /** Lookup table of 256 RGBA colours: 0 for no structure, then the structures in order; alpha is the opacity. */
  private readonly palette = computed<Uint8Array<ArrayBuffer>>(() => {
    const rgba = new Uint8Array(1024);
    this.appearances.value
      .slice(0, 255)
      .forEach((appearance, index) =>
        rgba.set(
          [...appearance.colour, appearance.visible ? Math.round(255 * appearance.opacity) : 0],
          (index + 1) * 4,
        ),
      );
    if (this.appearances.value.length < REMOVED) rgba.set(REMOVED_RGBA, 4 * REMOVED);
    const [highlighted, concealment] = [this.highlighted.value, this.concealment.value];
    if (highlighted !== null && highlighted >= 0 && highlighted < 255) rgba.set(HIGHLIGHT_RGBA, (highlighted + 1) * 4);
    for (const value of concealment?.values ?? [])
      rgba.copyWithin(4 * value, 4 * concealment!.as, 4 * concealment!.as + 4);
    return rgba;
  });
  /** Gloss of 256 structures, in the order of the palette. */
  private readonly gloss = computed<Uint8Array<ArrayBuffer>>(() => {
    const values = new Uint8Array(256);
    const scene = this.scene.value;
    scene?.structures
      .slice(0, 255)
      .forEach(({ tissue }, index) => (values[index + 1] = glossOf(scene.tissues[tissue]?.friction)));
    const concealment = this.concealment.value;
    for (const value of concealment?.values ?? []) values[value] = values[concealment!.as]!;
    return values;
  });
  /** Appearance of the volume: another object after every change of colours, voxels or deformation. */
  readonly appearance = computed(() => ({
    palette: this.palette.value,
    gloss: this.gloss.value,
    edits: this.edits.value,
  }));

  // ---- changes

  setScene(scene: Scene, volumes: Volumes): void {
    batch(() => {
      const isNew = !showsTheSame(scene, this.scene.peek());
      this.scene.value = scene;
      this.volumes.value = volumes;
      if (isNew || this.appearances.peek().length !== scene.structures.length) {
        this.appearances.value = restored(
          scene,
          appearancesOf(scene),
          recallScene<StoredScene>(scene.volume.hash).looks ?? {},
        );
        const [low, high] = scene.volume.scan?.window ?? [0, 1];
        this.window.value = this.baseWindow = this.recalledWindow() ?? {
          level: (low + high) / 2,
          width: Math.max(high - low, this.minWindowWidth),
        };
        this.planes.value = { ...this.planes.peek(), cross: null, follow: true };
      }
      this.trail = [];
      this.edits.value += 1;
    });
  }

  setPose(pose: Pose): void {
    batch(() => {
      this.pose.value = pose;
      // a paused recording repeats its pose
      if (this.trail.at(-1)?.time === pose.time) this.trail.pop();
      this.trail.push({ p: this.toolAt(pose.devices[0]!), time: pose.time });
      while (this.trail.length > 0 && this.trail[0]!.time < pose.time - TRAIL_S) this.trail.shift();
      if (this.trail.length > 1 && this.trail.at(-2)!.time > pose.time) this.trail = [];
    });
  }
  /** Moves the planes to a position, patient frame, where they stop following the tip. */
  showPosition(cross: Vec3, obliqueNormal = this.planes.peek().obliqueNormal): void {
    this.planes.value = { follow: false, cross, obliqueNormal };
  }

  // ---- subscriptions: called now if there is a value, and after each change

  onScene(show: (scene: Scene) => void): void {
    follow(this.scene, show);
  }
  onState(show: (state: State) => void): void {
    follow(this.state, show);
  }
  onPose(show: (pose: Pose) => void): void {
    follow(this.pose, show);
  }
  /** Updates figures; to be called ten times a second, because figures that change with every pose cannot be read. */
  updateFigures(now_ms: number): void {
    this.figures_ms.value = now_ms;
  }
  /** Registers a display of figures, called now and on each update. */
  onFigures(show: (now_ms: number) => void): void {
    effect(() => {
      const now_ms = this.figures_ms.value;
      untracked(() => show(now_ms));
    });
  }

  // ---- tools and positions

  private isHidden(label: number | null): boolean {
    return label !== null && this.quiz.value?.includes(label) === true;
  }
  /** Distances of a device's tool, except to structures to be found in a quiz. */
  nearTo(device: DevicePose): StructureDistance[] {
    return (this.near.value[device.number]?.structures ?? []).filter(({ label }) => !this.isHidden(label));
  }
  regionName(index: number): string {
    return this.quiz.value ? words.someRegion : readable(this.scene.value!.no_go[index]!.name);
  }

  /** Displayed position of a tool, patient frame: in contact, on the deformed surface; else at the tip. */
  toolAt(device: DevicePose): Vec3 {
    if (!(device.flags & Flag.contact) || device.flags & Flag.inside) return device.tip;
    return add(device.proxy, this.displacementAt.value(device.contacts[0]?.position ?? device.proxy));
  }
  /** Devices in drawing order: the first one on top. */
  get drawn(): DevicePose[] {
    return [...(this.pose.value?.devices ?? [])].reverse();
  }
  toolOf({ number }: DevicePose): DeviceTool {
    return this.scene.value!.tools[number]!;
  }
  /** Direction in the patient frame of a direction in World, for the object's rotation in a pose. */
  toPatient(pose: Pose, world: Vec3): Vec3 {
    return turn(this.patientFromWorld.value, rotate(conjugate(pose.rotation), world));
  }
  /** Point that all planes contain; patient frame. */
  anchor(): Vec3 {
    const tip = this.pose.value?.devices[0]?.tip;
    const { follow, cross } = this.planes.value;
    if (follow && tip) return tip;
    return cross ?? tip ?? this.volumes.value?.centre ?? [0, 0, 0];
  }

  // ---- window of the scan

  /** Minimum width of a window: a thousandth of the scan's quantization step, which may be far below 1. */
  get minWindowWidth(): number {
    return (this.scene.value?.volume.scan?.scale ?? 1) / 1000;
  }
  /** Offset and scale from a window as stored by the browser to values of this scan. */
  private windowUnit({ volume, modality }: Scene): [number, number] {
    const [low, high] = volume.scan?.window ?? [0, 1];
    return modality === "ct" ? [0, 1] : [low, Math.max(high - low, this.minWindowWidth)];
  }
  private recalledWindow(): Window | null {
    const scene = this.scene.peek()!;
    const stored = recall<StoredPage>(PAGE_KEY).windows?.[scene.modality];
    const [begin, unit] = this.windowUnit(scene);
    return stored && Number.isFinite(stored.level) && stored.width > 0
      ? { level: begin + unit * stored.level, width: Math.max(unit * stored.width, this.minWindowWidth) }
      : null;
  }
  /** Stores the window in the browser, if the user has changed it. */
  storeWindow(): void {
    const scene = this.scene.peek();
    const window = this.window.peek();
    if (!scene || window === this.baseWindow) return;
    this.baseWindow = window;
    const [begin, unit] = this.windowUnit(scene);
    store<StoredPage>(PAGE_KEY, {
      windows: {
        ...recall<StoredPage>(PAGE_KEY).windows,
        [scene.modality]: { level: (window.level - begin) / unit, width: window.width / unit },
      },
    });
  }
  /** Lower and upper end of the window, in stored (unscaled) values of the scan. */
  storedWindow(): [number, number] {
    const scan = this.scene.value?.volume.scan;
    const { level, width } = this.window.value;
    const low = level - width / 2;
    return scan ? [(low - scan.offset) / scan.scale, (low + width - scan.offset) / scan.scale] : [0, 1];
  }

  // ---- names

  /** Whether no structure of the scene has contact forces. */
  private readonly hasNothingToFeel = computed(() => {
    const scene = this.scene.value;
    return scene !== null && !this.quiz.value && !scene.tissues.some(({ touchable }) => touchable);
  });
  contactOf(device: DevicePose): Contact {
    const touches = device.label > 0;
    const isTouchable = touches && !(device.flags & WITHHELD && length(device.force) === 0);
    // a tip that started inside a structure has no contact without being in free space
    const index = this.volumes.value?.structureAt(device.tip) ?? null;
    const around = index === null ? null : this.nameAt(index);
    const name = touches ? (this.structureName(device.label) ?? words.unnamed(String(device.label))) : around;
    if (!touches && this.hasNothingToFeel.value) return { label: 0, words: words.nothingTouchable };
    if (name === null) return { label: 0, words: device.flags & Flag.outside ? words.outside : words.free };
    return isTouchable
      ? { label: device.label, words: this.withEnclosing(readable(name), device.label) }
      : { label: 0, words: words.touchesUntouchable(readable(name)) };
  }
  /** Name of a structure by its index; anonymous in a quiz. */
  nameAt(index: number): string {
    return this.quiz.value ? words.someStructure : this.scene.value!.structures[index]!.name;
  }
  /** Name of a structure in contact, with the structures that enclose it. */
  private withEnclosing(name: string, label: number): string {
    const within = this.quiz.value
      ? []
      : (this.scene.value?.structures.find((structure) => structure.label === label)?.within ?? []);
    const names = within.map((larger) => this.nameOf(larger));
    return names.length > 0 ? words.within(name, names.join(", ")) : name;
  }
  structureName(label: number): string | null {
    if (this.quiz.value) return words.someStructure;
    return this.scene.value?.structures.find((structure) => structure.label === label)?.name ?? null;
  }
  /** Display name of a structure by its label. */
  nameOf(label: number): string {
    return readable(this.structureName(label) ?? words.unnamed(String(label)));
  }
}

/** Calls a function with each value of a signal, and when another signal changes that it has read. */
function follow<T>(source: Signal<T | null>, show: (value: T) => void): void {
  effect(() => {
    const value = source.value;
    if (value !== null) show(value);
  });
}

/** Display form of an identifier: "femoral cartilage" of "femoral_cartilage". */
export const readable = (name: string): string => name.replaceAll("_", " ");
