// What the page shows and how: the one place where the parts of the page meet.

import { rotate, conjugate, turn, invert, type Affine, type Vec3 } from "./geometry.js";
import type { Look } from "./field.js";
import type { Scene, State, Volumes } from "./scene.js";
import type { DevicePose, Pose } from "./wire.js";
import { Flag } from "./wire.js";

export type Tool = "window" | "pan" | "ruler" | "angle" | "touch";
export interface Window { level: number; width: number } // of the scan's values

const TRAIL_S = 2;

export class Session {
  scene: Scene | null = null;
  volumes: Volumes | null = null;
  state: State | null = null;
  pose: Pose | null = null;
  isFresh = false;
  age_ms = Infinity;

  looks: Look[] = []; // of the structures in their order
  window: Window = { level: 0, width: 1 };
  fill = 0.45;
  outlines = true;
  scanInVolume = 0;
  tool: Tool = "window";
  convention: "LPS" | "RAS" = "LPS";
  follow = true; // the planes go through the tip
  cross: Vec3 | null = null; // where they go through otherwise
  pointed: Vec3 | null = null; // the point under the mouse
  holding = false; // this page moves the tip just now
  trail: { p: Vec3; time: number }[] = [];

  fieldVersion = 0; // another one: the volume's colours are to be made anew
  lookVersion = 0; // another one: the sections' colours are
  version = 0; // another one: something on the page has changed

  private patientFromWorld: Affine = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];

  touch(): void {
    this.version += 1;
  }
  touchLooks(): void {
    this.lookVersion += 1;
    this.fieldVersion += 1;
    this.touch();
  }

  setScene(scene: Scene, volumes: Volumes): void {
    const isNew = this.scene?.volume.hash !== scene.volume.hash;
    this.scene = scene;
    this.volumes = volumes;
    this.patientFromWorld = invert(scene.world_from_patient);
    if (isNew || this.looks.length !== scene.structures.length) {
      this.looks = scene.structures.map((structure) => ({
        colour: structure.colour,
        opacity: scene.tissues[structure.tissue]?.opacity ?? 1,
        visible: true,
      }));
      const [low, high] = scene.volume.scan?.window ?? [0, 1];
      this.window = { level: (low + high) / 2, width: Math.max(high - low, 1e-3) };
      this.cross = null;
      this.follow = true;
    }
    this.trail = [];
    this.touchLooks();
  }

  setPose(pose: Pose): void {
    this.pose = pose;
    const shown = this.toolAt(pose.devices[0]!);
    this.trail.push({ p: shown, time: pose.time });
    while (this.trail.length > 0 && this.trail[0]!.time < pose.time - TRAIL_S) this.trail.shift();
    if (this.trail.length > 1 && this.trail.at(-2)!.time > pose.time) this.trail = [];
    this.touch();
  }

  /** Where the tool is drawn: held at the surface while it touches. */
  toolAt(device: DevicePose): Vec3 {
    return device.flags & Flag.contact && !(device.flags & Flag.inside) ? device.proxy : device.tip;
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
  /** In stored values of the scan. */
  storedWindow(): [number, number] {
    const scan = this.scene?.volume.scan;
    const low = this.window.level - this.window.width / 2;
    return scan ? [(low - scan.offset) / scan.scale, (low + this.window.width - scan.offset) / scan.scale] : [0, 1];
  }
  /** 256 colours for the slicer. */
  palette(): Uint8Array {
    const rgba = new Uint8Array(1024);
    this.looks.slice(0, 255).forEach((look, place) =>
      rgba.set([...look.colour, look.visible ? Math.round(255 * look.opacity) : 0], (place + 1) * 4));
    return rgba;
  }
  structureName(label: number): string | null {
    return this.scene?.structures.find((structure) => structure.label === label)?.name ?? null;
  }
}

/** "femoral_cartilage" for people. */
export const readable = (name: string): string => name.replaceAll("_", " ");
