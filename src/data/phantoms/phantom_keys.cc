#include "phantoms/phantom_keys.h"

#include <array>
#include <type_traits>

#include "phantoms/knee_phantom_anatomy.h"

namespace palpate {
namespace {

using namespace std::string_view_literals;

constexpr std::array kSides{"left"sv, "right"sv};
constexpr std::array kAnswers{"yes"sv, "no"sv};
constexpr std::array kCartilages{"femoral_cartilage"sv, "lateral_tibial_cartilage"sv,
                                 "medial_tibial_cartilage"sv, "patellar_cartilage"sv};
constexpr std::array kSoft{"anterior_cruciate_ligament"sv,  "femoral_cartilage"sv,
                           "fibular_collateral_ligament"sv, "lateral_meniscus"sv,
                           "lateral_tibial_cartilage"sv,    "medial_meniscus"sv,
                           "medial_tibial_cartilage"sv,     "patellar_cartilage"sv,
                           "patellar_ligament"sv,           "posterior_cruciate_ligament"sv,
                           "tibial_collateral_ligament"sv};
constexpr std::array kStructures{"anterior_cruciate_ligament"sv,
                                 "femoral_cartilage"sv,
                                 "femur"sv,
                                 "fibula"sv,
                                 "fibular_collateral_ligament"sv,
                                 "lateral_meniscus"sv,
                                 "lateral_tibial_cartilage"sv,
                                 "medial_meniscus"sv,
                                 "medial_tibial_cartilage"sv,
                                 "patella"sv,
                                 "patellar_cartilage"sv,
                                 "patellar_ligament"sv,
                                 "posterior_cruciate_ligament"sv,
                                 "tibia"sv,
                                 "tibial_collateral_ligament"sv};
constexpr std::uint64_t kMaxSeed = 1'000'000'000;

// visits an enumeration or a flag as a word
template <class T>
void choice(PhantomKeyVisitor& v, const PhantomKey& key, std::span<const std::string_view> words, T& value,
            T first, T second) {
  std::string text(value == first ? words[0] : words[1]);
  v.word(key, words, text);
  value = text == words[0] ? first : second;
}

void visit_islands(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.integer({"islands", "", "Number of stray islands in the segmentation, and of holes in its structures."},
            1000, s.islands);
}
void visit_noise(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.number({"noise", "mm",
            "Standard deviation of segmented borders in each slice, as in manual segmentation. Slices are "
            "perpendicular to the largest voxel spacing."},
           0, 1.5, s.noise_mm);
}
void visit_scan_seed(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.integer({"scan-seed", "", "Standard deviation of the noise in the scan."}, kMaxSeed, s.scan_seed);
}
void visit_seed(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.integer({"seed", "", "Seed of the natural variation, of `noise` and of `islands`; 0 is the mean shape."},
            kMaxSeed, s.seed);
}
void visit_spacing(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.edges({"spacing", "mm", "Voxel spacing: one number, or three along x, y and z, such as `0.28x0.28x1`."},
          0.2, 3, s.spacing_mm);
}

void visit(KneeParameters& p, PhantomKeyVisitor& v) {
  v.number({"burr", "mm",
            "Diameter of a burr, at least two voxels; 0: the tool is a point. Part of the phantom's scene, "
            "not of exported labels."},
           0, 6, p.burr_mm);
  v.number({"defect", "mm", "Radius of a defect through the whole thickness of a cartilage; 0: none."}, 0, 12,
           p.defect_mm);
  v.word({"defect-in", "", "Structure that has the `defect`."}, kCartilages, p.defect_in);
  visit_islands(p.settings, v);
  v.number({"lesion", "mm", "Radius of a round lesion with a label of its own, `lesion`, 200; 0: none."}, 0,
           15, p.lesion_mm);
  v.integer({"lesion-at", "",
             "Place of `lesion` on its structure: 0 is the usual one; a cartilage has three more."},
            kMaxKneeSites - 1, p.lesion_at);
  v.number({"lesion-depth", "mm",
            "Depth of the centre of `lesion` below the surface of its structure; 0: a hemisphere that can be "
            "touched."},
           0, 20, p.lesion_depth_mm);
  v.word({"lesion-in", "", "Structure that contains `lesion`."}, kStructures, p.lesion_in);
  v.words({"missing", "", "Missing structures, joined by `+`."}, kSoft, p.missing);
  visit_noise(p.settings, v);
  visit_scan_seed(p.settings, v);
  visit_seed(p.settings, v);
  choice(v, {"side", "", "A right knee is the mirror image of the left one."}, kSides, p.side,
         BodySide::kLeft, BodySide::kRight);
  v.number({"size", "", "Scale of the anatomy: 0.6 a small child, 1.15 a large adult."}, 0.5, 1.3, p.size);
  visit_spacing(p.settings, v);
  choice(v, {"visible", "", "Whether the scan shows `lesion`; labels always do."}, kAnswers, p.visible, true,
         false);
}

void visit(ShellParameters& p, PhantomKeyVisitor& v) {
  visit_islands(p.settings, v);
  visit_noise(p.settings, v);
  v.number({"radius", "mm", "Radius of the outer surface."}, 5, 60, p.radius_mm);
  visit_scan_seed(p.settings, v);
  visit_seed(p.settings, v);
  visit_spacing(p.settings, v);
  v.number({"thickness", "mm", "Thickness of the wall; at least the diagonal of a voxel."}, 0.4, 20,
           p.thickness_mm);
}

void visit(SkullParameters& p, PhantomKeyVisitor& v) {
  choice(v, {"brain", "", "Whether there is a brain inside."}, kAnswers, p.brain, true, false);
  visit_islands(p.settings, v);
  visit_noise(p.settings, v);
  visit_scan_seed(p.settings, v);
  visit_seed(p.settings, v);
  v.number({"size", "", "Scale of the head; `temporal` and `thickness` stay in mm."}, 0.5, 1.3, p.size);
  visit_spacing(p.settings, v);
  v.number({"temporal", "mm", "Wall at the temples and of the orbits; at least the diagonal of a voxel."},
           0.5, 10, p.temporal_mm);
  v.number({"thickness", "mm", "Wall of the cranium elsewhere; at least `temporal`."}, 0.5, 15,
           p.thickness_mm);
}

void visit(GlandParameters& p, PhantomKeyVisitor& v) {
  v.number({"fat", "mm", "Layer over jaw and gland; 0: none."}, 0, 15, p.fat_mm);
  v.number({"gland", "mm", "Length of the gland."}, 10, 40, p.gland_mm);
  visit_islands(p.settings, v);
  visit_noise(p.settings, v);
  visit_scan_seed(p.settings, v);
  visit_seed(p.settings, v);
  v.number({"size", "", "Scale of the jaw; `fat`, `gland` and `skin` stay in mm."}, 0.5, 1.3, p.size);
  v.number({"skin", "mm", "Layer over `fat`, or over jaw and gland; 0: none."}, 0, 5, p.skin_mm);
  visit_spacing(p.settings, v);
}

// keys common to block and dome, between which each has keys of its own
void visit_depth_and_diameter(NoduleParameters& p, PhantomKeyVisitor& v) {
  v.number({"depth", "mm",
            "Thickness of soft tissue over each nodule, along the surface normal; at least the diagonal of a "
            "voxel."},
           1, 40, p.depth_mm);
  v.number(
      {"diameter", "mm", "Diameter of each nodule; at least three voxels, with 2 mm of tissue below it."}, 2,
      30, p.diameter_mm);
}
void visit_nodules(NoduleParameters& p, PhantomKeyVisitor& v) {
  v.integer({"nodules", "", "Number of nodules, with centres at least 1.5 diameters apart."}, 12, p.nodules);
}
void visit_position_seed(PhantomSettings& s, PhantomKeyVisitor& v) {
  v.integer({"seed", "",
             "Seed of the places of the nodules, of `noise` and of `islands`; with 0 the first nodule is in "
             "the centre."},
            kMaxSeed, s.seed);
}
void visit_stiffness(NoduleParameters& p, PhantomKeyVisitor& v) {
  v.number({"stiffness", "",
            "Ratio of the Young's modulus of the nodules to that of the tissue. Part of the phantom's scene, "
            "not of exported labels."},
           1, 100, p.stiffness);
}
void visit_visible(NoduleParameters& p, PhantomKeyVisitor& v) {
  choice(v, {"visible", "", "Whether the scan shows the nodules; labels always do."}, kAnswers, p.visible,
         true, false);
}

void visit(BlockParameters& p, PhantomKeyVisitor& v) {
  visit_depth_and_diameter(p.nodules, v);
  visit_islands(p.settings, v);
  visit_nodules(p.nodules, v);
  visit_noise(p.settings, v);
  visit_scan_seed(p.settings, v);
  visit_position_seed(p.settings, v);
  visit_spacing(p.settings, v);
  visit_stiffness(p.nodules, v);
  v.number({"thickness", "mm", "Thickness of the tissue on the plate."}, 10, 80, p.thickness_mm);
  visit_visible(p.nodules, v);
  v.number({"width", "mm", "Edge of the block, in both directions."}, 30, 150, p.width_mm);
}

void visit(DomeParameters& p, PhantomKeyVisitor& v) {
  visit_depth_and_diameter(p.nodules, v);
  v.number({"height", "mm", "Height of the dome above the plate."}, 15, 80, p.height_mm);
  visit_islands(p.settings, v);
  visit_nodules(p.nodules, v);
  visit_noise(p.settings, v);
  v.number({"radius", "mm", "Radius of the dome's base."}, 20, 80, p.radius_mm);
  visit_scan_seed(p.settings, v);
  visit_position_seed(p.settings, v);
  visit_spacing(p.settings, v);
  visit_stiffness(p.nodules, v);
  visit_visible(p.nodules, v);
}

void visit(AbdomenParameters& p, PhantomKeyVisitor& v) {
  v.number({"edge", "mm", "Radius of the firm edge of the liver; 0: none."}, 0, 8, p.edge_mm);
  v.number({"fat", "mm", "Layer under the skin; 0: none."}, 0, 40, p.fat_mm);
  visit_islands(p.settings, v);
  v.number({"muscle", "mm", "Layer under the fat."}, 2, 25, p.muscle_mm);
  visit_noise(p.settings, v);
  choice(v, {"rib", "", "Whether there is a rib above the edge of the liver."}, kAnswers, p.rib, true, false);
  visit_scan_seed(p.settings, v);
  v.integer({"seed", "",
             "Seed of the position of edge and rib, of `noise` and of `islands`; 0 is the mean position."},
            kMaxSeed, p.settings.seed);
  v.number({"skin", "mm", "Outermost layer."}, 1, 5, p.skin_mm);
  visit_spacing(p.settings, v);
}

void visit(TemporalBoneParameters& p, PhantomKeyVisitor& v) {
  v.number({"cells", "mm", "Mean diameter of the air cells, at least three voxels; 0: none."}, 0, 6,
           p.cells_mm);
  v.number({"cortex", "mm", "Cortex over the air cells; at least the diagonal of a voxel."}, 0.5, 6,
           p.cortex_mm);
  visit_islands(p.settings, v);
  visit_noise(p.settings, v);
  v.number({"plate", "mm", "Plates of bone over dura and sigmoid sinus; at least the diagonal of a voxel."},
           0.4, 4, p.plate_mm);
  visit_scan_seed(p.settings, v);
  visit_seed(p.settings, v);
  choice(v, {"side", "", "A right temporal bone is the mirror image of the left one."}, kSides, p.side,
         BodySide::kLeft, BodySide::kRight);
  visit_spacing(p.settings, v);
}

}  // namespace

void visit_keys(PhantomParameters& parameters, PhantomKeyVisitor& visitor) {
  std::visit([&](auto& p) { visit(p, visitor); }, parameters);
}

const std::vector<PhantomParameters>& mean_phantoms() {
  static const std::vector<PhantomParameters> kMean{
      KneeParameters{},  ShellParameters{}, SkullParameters{},   GlandParameters{},
      BlockParameters{}, DomeParameters{},  AbdomenParameters{}, TemporalBoneParameters{}};
  return kMean;
}

const std::vector<std::string>& phantom_names() {
  static const std::vector<std::string> kNames{"knee-phantom",   "shell-phantom",   "skull-phantom",
                                               "gland-phantom",  "palpation-block", "palpation-dome",
                                               "abdominal-wall", "temporal-bone"};
  return kNames;
}

const std::string& base_name(const PhantomParameters& parameters) {
  return phantom_names()[parameters.index()];
}

PhantomSettings& settings_of(PhantomParameters& parameters) {
  return std::visit([](auto& p) -> PhantomSettings& { return p.settings; }, parameters);
}
const PhantomSettings& settings_of(const PhantomParameters& parameters) {
  return std::visit([](const auto& p) -> const PhantomSettings& { return p.settings; }, parameters);
}

}  // namespace palpate
