// Appearance of structures: presets, and restoring what the browser has stored.

import type { Rgb, Scene, Structure } from "../protocol/messages.js";

export const PRESETS = ["scene", "solid", "bone", "translucent"] as const;
export type AppearancePreset = (typeof PRESETS)[number];
/** Appearance of one structure in all pictures; opacity 0 to 1. */
export interface Appearance {
  colour: Rgb;
  opacity: number;
  visible: boolean;
}

const wordSet = (text: string): Set<string> => new Set(text.trim().split(/\s+/));
/**
 * Words that identify bones in names of tissues and structures. Names of single bones are those by which
 * src/data/scene/preset_matching.cc chooses a tissue.
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

const hiddenNames = new Set<string>();
/** Hides structures of this name in the initial appearance of scenes: they are to be found by touch. */
export const hideInitially = (name: string): void => void hiddenNames.add(name);

/** Initial appearances of a scene. */
export const appearancesOf = (scene: Scene): Appearance[] =>
  scene.structures.map(({ colour, name, tissue }) => ({
    colour,
    opacity: scene.tissues[tissue]?.opacity ?? 1,
    visible: !hiddenNames.has(name),
  }));

/** Appearance of a preset; all presets but "scene" keep the current colours. */
export function presetAppearances(preset: AppearancePreset, scene: Scene, now: Appearance[]): Appearance[] {
  if (preset === "scene") return appearancesOf(scene);
  return now.map(({ colour }, index) => {
    const isHard = isBone(scene, scene.structures[index]!);
    return {
      colour,
      opacity: preset === "translucent" && !isHard ? TRANSLUCENT : 1,
      visible: preset !== "bone" || isHard,
    };
  });
}

/** Stored appearances by label, because the order of structures may change. */
export type StoredAppearances = Record<number, Appearance>;
export const storedAppearances = (scene: Scene, appearances: Appearance[]): StoredAppearances =>
  Object.fromEntries(scene.structures.map(({ label }, index) => [label, appearances[index]!]));

/** Stored appearances where valid, current ones elsewhere. */
export function restored(scene: Scene, now: Appearance[], stored: StoredAppearances): Appearance[] {
  const isPart = (x: unknown, most: number) => typeof x === "number" && x >= 0 && x <= most;
  return now.map((own, index) => {
    const appearance = stored[scene.structures[index]!.label] as Partial<Appearance> | undefined;
    const isAppearance =
      appearance &&
      Array.isArray(appearance.colour) &&
      appearance.colour.length === 3 &&
      appearance.colour.every((x) => isPart(x, 255)) &&
      isPart(appearance.opacity, 1);
    return isAppearance
      ? { colour: appearance.colour!, opacity: appearance.opacity!, visible: appearance.visible !== false }
      : own;
  });
}
