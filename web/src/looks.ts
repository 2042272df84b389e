// Looks of all structures at once, and how they are kept.

import type { Scene, Structure } from "./scene.js";
import type { Look } from "./session.js";

export const PRESETS = ["scene", "solid", "bone", "translucent"] as const;
export type LooksPreset = (typeof PRESETS)[number];

const wordSet = (text: string): Set<string> => new Set(text.split(/\s+/));
/** What a structure is, words of its tissue's name or of its own say. Single bones are those by which src/scene/presets.cc chooses a tissue. */
const BONES = wordSet(`bone bony trabecular osseous vertebral skeleton skeletal ribcage
  femur tibia fibula patella rib vertebra sacrum coccyx hip pelvis ilium ischium pubis scapula clavicula clavicle humerus ulna radius
  skull cranium mandible mandibula maxilla sternum carpal carpus metacarpal tarsal tarsus metatarsal phalanx phalanges talus
  calcaneus navicular cuboid cuneiform acetabulum fabella sesamoid spine hyoid jaw tooth teeth zygoma zygomatic vomer ethmoid sphenoid
  cortical scaphoid lunate triquetrum pisiform trapezium trapezoid capitate hamate costa kneecap`);
/** And these that it is beside a bone or within one, or that the word means something else. */
const OTHERS = wordSet(`cartilage muscle tendon ligament ligamentum nerve artery arteries vein vena vessel marrow disc disk fat joint capsule
  meniscus menisci skin sinus pulp canal tunnel cord renal kidney cyst fluid effusion lumen air gas csf`);
/** Or in the plural: ribs, scapulae. */
const isOf = (words: Set<string>, word: string): boolean => words.has(word) || words.has(word.replace(/[se]$/, ""));
const TRANSLUCENT = 0.3;

/** "LeftFemur2" is "left", "femur". */
const wordsOf = (name: string): string[] => name.replace(/(\p{Ll})(\p{Lu})/gu, "$1 $2").toLowerCase().split(/[^\p{L}]+/u);

function isBone(scene: Scene, { name, tissue }: Structure): boolean {
  const all = wordsOf(`${scene.tissues[tissue]?.name ?? ""} ${name}`);
  return all.some((word) => isOf(BONES, word) || /bones?$/.test(word)) && !all.some((word) => isOf(OTHERS, word));
}
export const hasBone = (scene: Scene): boolean => scene.structures.some((structure) => isBone(scene, structure));

/** As a scene says that its structures look. */
export const looksOf = (scene: Scene): Look[] => scene.structures.map(({ colour, tissue }) => ({ colour, opacity: scene.tissues[tissue]?.opacity ?? 1, visible: true }));

/** Of a preset; colours stay as they are, but for that of the scene. */
export function presetLooks(preset: LooksPreset, scene: Scene, now: Look[]): Look[] {
  if (preset === "scene") return looksOf(scene);
  return now.map(({ colour }, place) => {
    const isHard = isBone(scene, scene.structures[place]!);
    return { colour, opacity: preset === "translucent" && !isHard ? TRANSLUCENT : 1, visible: preset !== "bone" || isHard };
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
