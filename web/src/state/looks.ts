// Appearance of structures: presets, and restoring what the browser has stored.

import type { Rgb, Scene, Structure } from "../protocol/messages.js";

export const PRESETS = ["scene", "solid", "bone", "translucent"] as const;
export type LooksPreset = (typeof PRESETS)[number];
/** Appearance of one structure in all pictures; opacity 0 to 1. */
export interface Look {
  colour: Rgb;
  opacity: number;
  visible: boolean;
}

const wordSet = (text: string): Set<string> => new Set(text.trim().split(/\s+/));
/**
 * Words that identify bones in names of tissues and structures. Names of single bones are those by which
 * src/scene/presets.cc chooses a tissue.
 */
const BONES = wordSet(`
  bone bony trabecular osseous vertebral skeleton skeletal ribcage femur tibia fibula patella rib vertebra
  sacrum coccyx hip pelvis ilium ischium pubis scapula clavicula clavicle humerus ulna radius skull cranium
  mandible mandibula maxilla sternum carpal carpus metacarpal tarsal tarsus metatarsal phalanx phalanges talus
  calcaneus navicular cuboid cuneiform acetabulum fabella sesamoid spine hyoid jaw tooth teeth zygoma
  zygomatic vomer ethmoid sphenoid cortical scaphoid lunate triquetrum pisiform trapezium trapezoid capitate
  hamate costa kneecap
`);
/** Words that exclude bones: structures next to or within a bone, or another meaning of a word of BONES. */
const OTHERS = wordSet(`
  cartilage muscle tendon ligament ligamentum nerve artery arteries vein vena vessel marrow disc disk fat
  joint capsule meniscus menisci skin sinus pulp canal tunnel cord renal kidney cyst fluid effusion lumen air
  gas csf
`);
/** Whether a word or its singular (ribs, scapulae) is in a set. */
const isOf = (words: Set<string>, word: string): boolean => words.has(word) || words.has(word.replace(/[se]$/, ""));
const TRANSLUCENT = 0.3;

/** Lower-case words of a name: "left", "femur" of "LeftFemur2". */
const wordsOf = (name: string): string[] =>
  name
    .replace(/(\p{Ll})(\p{Lu})/gu, "$1 $2")
    .toLowerCase()
    .split(/[^\p{L}]+/u);

function isBone(scene: Scene, { name, tissue }: Structure): boolean {
  const all = wordsOf(`${scene.tissues[tissue]?.name ?? ""} ${name}`);
  return all.some((word) => isOf(BONES, word) || /bones?$/.test(word)) && !all.some((word) => isOf(OTHERS, word));
}
export const hasBone = (scene: Scene): boolean => scene.structures.some((structure) => isBone(scene, structure));

/** Coefficient of friction from which on a surface looks dry. */
const DRY_FRICTION = 0.3;
/**
 * Gloss of a surface, 0 to 255: what slides well is wet.
 * @param friction  of the tissue; undefined: structures without a tissue, which look dry
 */
export const glossOf = (friction: number | undefined): number =>
  Math.round(255 * Math.max(0, 1 - (friction ?? DRY_FRICTION) / DRY_FRICTION) ** 2);

/** Initial looks of a scene. */
export const looksOf = (scene: Scene): Look[] =>
  scene.structures.map(({ colour, tissue }) => ({
    colour,
    opacity: scene.tissues[tissue]?.opacity ?? 1,
    visible: true,
  }));

/** Looks of a preset; all presets but "scene" keep the current colours. */
export function presetLooks(preset: LooksPreset, scene: Scene, now: Look[]): Look[] {
  if (preset === "scene") return looksOf(scene);
  return now.map(({ colour }, place) => {
    const isHard = isBone(scene, scene.structures[place]!);
    return {
      colour,
      opacity: preset === "translucent" && !isHard ? TRANSLUCENT : 1,
      visible: preset !== "bone" || isHard,
    };
  });
}

/** Stored looks by label, because the order of structures may change. */
export type KeptLooks = Record<number, Look>;
export const keptLooks = (scene: Scene, looks: Look[]): KeptLooks =>
  Object.fromEntries(scene.structures.map(({ label }, place) => [label, looks[place]!]));

/** Stored looks where valid, current ones elsewhere. */
export function restored(scene: Scene, now: Look[], kept: KeptLooks): Look[] {
  const isPart = (x: unknown, most: number) => typeof x === "number" && x >= 0 && x <= most;
  return now.map((own, place) => {
    const look = kept[scene.structures[place]!.label] as Partial<Look> | undefined;
    const isLook =
      look &&
      Array.isArray(look.colour) &&
      look.colour.length === 3 &&
      look.colour.every((x) => isPart(x, 255)) &&
      isPart(look.opacity, 1);
    return isLook ? { colour: look.colour!, opacity: look.opacity!, visible: look.visible !== false } : own;
  });
}
