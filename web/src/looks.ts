// Looks of all structures at once, and how they are kept.

import type { Scene } from "./scene.js";
import type { Look } from "./session.js";

export const PRESETS = ["scene", "solid", "bone", "translucent"] as const;
export type LooksPreset = (typeof PRESETS)[number];

/** A tissue says what it is by its name alone. */
const BONE = /bone|skull|skelet|cortical|vertebra|\brib|tooth|teeth/i;
const TRANSLUCENT = 0.3;

export const hasBone = (scene: Scene): boolean => scene.structures.some(({ tissue }) => BONE.test(scene.tissues[tissue]?.name ?? ""));

/** As a scene says that its structures look. */
export const looksOf = (scene: Scene): Look[] => scene.structures.map(({ colour, tissue }) => ({ colour, opacity: scene.tissues[tissue]?.opacity ?? 1, visible: true }));

/** Of a preset; colours stay as they are, but for that of the scene. */
export function presetLooks(preset: LooksPreset, scene: Scene, now: Look[]): Look[] {
  if (preset === "scene") return looksOf(scene);
  return now.map(({ colour }, place) => {
    const isBone = BONE.test(scene.tissues[scene.structures[place]!.tissue]?.name ?? "");
    return { colour, opacity: preset === "translucent" && !isBone ? TRANSLUCENT : 1, visible: preset !== "bone" || isBone };
  });
}

/** By label, for a list may be in another order at another time. */
export type KeptLooks = Record<number, Look>;
export const keptLooks = (scene: Scene, looks: Look[]): KeptLooks => Object.fromEntries(scene.structures.map(({ label }, place) => [label, looks[place]!]));

/** Those that were kept, where they are looks. */
export function restored(scene: Scene, now: Look[], kept: KeptLooks): Look[] {
  const isPart = (x: unknown, most: number) => typeof x === "number" && x >= 0 && x <= most;
  return now.map((own, place) => {
    const look = kept[scene.structures[place]!.label] as Partial<Look> | undefined;
    const isLook = look && Array.isArray(look.colour) && look.colour.length === 3 && look.colour.every((x) => isPart(x, 255)) && isPart(look.opacity, 1);
    return isLook ? { colour: look.colour!, opacity: look.opacity!, visible: look.visible !== false } : own;
  });
}
