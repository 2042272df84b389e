#include <array>
#include <cmath>
#include <cstdio>

#include "palpate/scene.h"
#include "scene/keys.h"

namespace palpate {
namespace {

// a blunt probe: a flat punch of this radius
constexpr double kProbeRadius_mm = 1.5;
// the spring in series that stands for the device: a Premium 1.5 at 1 kHz with 1 ms of delay begins to
// buzz at 1.9 N/mm in a light grip (simulated plant); this keeps a fifth away from it
constexpr double kDeviceStiffness_N_per_mm = 1.5;

/// Indentation of a half-space by a flat punch: K = 2 a E / (1 - nu^2) (Sneddon 1965).
double punch_stiffness(double modulus_MPa, double poisson) {
  return 2 * kProbeRadius_mm * modulus_MPa / (1 - poisson * poisson);
}

/// A tube pinched across its diameter: K = E I / (0.149 R^3), I = b t^3 / 12 (Roark's ring under two
/// opposite loads), over the probe's width.
double tube_stiffness(double modulus_MPa, double radius_mm, double wall_mm) {
  const double second_moment = 2 * kProbeRadius_mm * wall_mm * wall_mm * wall_mm / 12;
  return modulus_MPa * second_moment / (0.149 * radius_mm * radius_mm * radius_mm);
}

/// What is felt through the device's spring, to 0.01 N/mm, or 0.001 N/mm below 0.1: it keeps the order of
/// tissues, leaves soft ones as they are and never exceeds the device's own stiffness.
double felt_stiffness(double tissue_N_per_mm) {
  const double felt =
      tissue_N_per_mm * kDeviceStiffness_N_per_mm / (tissue_N_per_mm + kDeviceStiffness_N_per_mm);
  const double steps = felt < 0.1 ? 1000 : 100;
  return std::round(felt * steps) / steps;
}

struct Surface {
  double friction, damping_N_s_per_mm, max_N, viscosity_N_s_per_mm;
};

TissuePreset make(std::string name, double tissue_N_per_mm, const Surface& surface, double opacity,
                  const std::string& source, std::vector<std::string> kind_words,
                  std::vector<std::string> structure_names) {
  TissuePreset preset;
  preset.values.preset = name;
  preset.values.stiffness_N_per_mm = felt_stiffness(tissue_N_per_mm);
  preset.values.friction_coefficient = surface.friction;
  preset.values.friction_damping_N_s_per_mm = surface.damping_N_s_per_mm;
  preset.values.friction_max_N = surface.max_N;
  preset.values.viscosity_N_s_per_mm = surface.viscosity_N_s_per_mm;
  preset.values.opacity = opacity;
  std::array<char, 64> stiffness{};
  std::snprintf(stiffness.data(), stiffness.size(), "; under the probe %.3g N/mm", tissue_N_per_mm);
  preset.source = source + stiffness.data();
  preset.name = std::move(name);
  preset.kind_words = std::move(kind_words);
  preset.structure_names = std::move(structure_names);
  return preset;
}

std::vector<TissuePreset> make_presets() {
  // equilibrium modulus of cartilage: E = H_A (1 + nu)(1 - 2 nu)/(1 - nu) with nu = 0.1
  const double cartilage_MPa = 0.79 * 1.1 * 0.8 / 0.9;
  std::vector<TissuePreset> presets;
  presets.push_back(make(
      "bone", punch_stiffness(18600, 0.3), {0.2, 0.005, 0.5, 0.001}, 1,
      "Rho, Ashman, Turner 1993, J Biomech 26:111: cortical bone of the human tibia, E = 18.6 GPa by "
      "microtensile test; nu = 0.3",
      {"bone", "bony", "cortical", "trabecular"},
      {"femur",     "tibia",     "fibula",  "patella",   "rib",        "ribs",    "vertebra",  "vertebrae",
       "sacrum",    "coccyx",    "hip",     "pelvis",    "ilium",      "ischium", "pubis",     "scapula",
       "clavicula", "clavicle",  "humerus", "ulna",      "radius",     "skull",   "cranium",   "mandible",
       "maxilla",   "sternum",   "carpal",  "carpus",    "metacarpal", "tarsal",  "tarsus",    "metatarsal",
       "phalanx",   "phalanges", "talus",   "calcaneus", "navicular",  "cuboid",  "cuneiform", "acetabulum",
       "fabella",   "sesamoid",  "spine"}));
  presets.push_back(
      make("cartilage", punch_stiffness(cartilage_MPa, 0.1), {0.025, 0.002, 0.1, 0.001}, 1,
           "Armstrong, Mow 1982, J Bone Joint Surg Am 64:88: human patellar cartilage, mean aggregate "
           "modulus 0.79 MPa at equilibrium; nu = 0.1, E = 0.77 MPa",
           {"cartilage", "chondral"}, {"labrum"}));
  presets.back().source +=
      ". Friction: Bonnevie et al. 2011, Tribol Lett 41:83: 0.025 under a probe that slides at 1 to 5 mm/s";
  presets.push_back(
      make("meniscus", punch_stiffness(0.12, 0), {0.05, 0.002, 0.2, 0.001}, 1,
           "Sweigart et al. 2004, Ann Biomed Eng 32:1569: human medial meniscus, aggregate modulus "
           "0.16 MPa in front, 0.10 MPa in the middle and behind; their mean 0.12 MPa, nu = 0",
           {"meniscus", "menisci", "meniscal"}, {}));
  presets.push_back(
      make("ligament", punch_stiffness(11.0, 0.5), {0.1, 0.003, 0.3, 0.001}, 1,
           "Quapp, Weiss 1998, J Biomech Eng 120:757: human medial collateral ligament across its fibres, "
           "tangent modulus 11.0 MPa (332 MPa along them); nu = 0.5",
           {"ligament", "ligamentum", "tendon", "aponeurosis", "retinaculum"},
           {"iliotibial tract", "iliotibial band", "acl", "pcl", "mcl", "lcl"}));
  presets.push_back(make(
      "muscle", punch_stiffness(3 * 0.0045, 0.5), {0.1, 0.003, 0.2, 0.003}, 0.6,
      "Chakouch, Charleux, Bensamoun 2015, PLoS ONE 10:e0138873: nine human thigh muscles at rest, shear "
      "modulus 3.9 to 6.2 kPa; taken 4.5 kPa, E = 3 mu, nu = 0.5",
      {"muscle", "muscular"},
      {"gluteus", "autochthon", "iliopsoas", "psoas", "quadriceps", "sartorius", "gastrocnemius", "soleus",
       "gracilis", "semimembranosus", "semitendinosus", "deltoid", "trapezius", "pectoralis", "supraspinatus",
       "infraspinatus", "subscapularis", "masseter", "temporalis"}));
  presets.push_back(
      make("fat", punch_stiffness(3 * 0.00304, 0.5), {0.05, 0.002, 0.1, 0.002}, 0.4,
           "Chakouch, Charleux, Bensamoun 2015, PLoS ONE 10:e0138873: fat under the skin of the human "
           "thigh, shear modulus 3.04 kPa; E = 3 mu, nu = 0.5",
           {"fat", "fatty", "adipose"}, {}));
  presets.push_back(make(
      "vessel", tube_stiffness(0.771, 3, 1), {0.05, 0.002, 0.1, 0.001}, 1,
      "Riley et al. 1992, Stroke 23:952: wall of the human carotid artery, E = 771 kPa in men of 45 to 49 "
      "years; as a tube without pressure (tourniquet) of radius 3 mm and wall 1 mm",
      {"artery", "arteries", "arteriole", "vein", "vena", "venous", "arterial", "vessel", "vascular"},
      {"aorta", "brachiocephalic trunk", "celiac trunk", "vena cava", "saphenous"}));
  presets.push_back(
      make("nerve", punch_stiffness(3 * 0.0129, 0.5), {0.1, 0.003, 0.2, 0.001}, 1,
           "Main et al. 2011, J Biomech 44:863: human median nerve compressed across, first-order Ogden "
           "mu = 12.9 kPa, taken as the shear modulus at small strain; E = 3 mu, nu = 0.5",
           {"nerve", "nervus", "plexus"}, {"sciatic"}));
  return presets;
}

// ---- matching -----------------------------------------------------------------------------------

bool is_upper(char c) {
  return c >= 'A' && c <= 'Z';
}
bool is_letter(char c) {
  return is_upper(c) || (c >= 'a' && c <= 'z');
}

/// Runs of letters in lower case; "LeftFemur2" is "left", "femur".
std::vector<std::string> words_of(const std::string& name) {
  std::vector<std::string> words;
  char before = ' ';
  for (const char c : name) {
    if (is_letter(c)) {
      if (!is_letter(before) || (is_upper(c) && !is_upper(before))) words.emplace_back();
      words.back() += static_cast<char>(is_upper(c) ? c - 'A' + 'a' : c);
    }
    before = c;
  }
  return words;
}

/// The last place in `words` where the pattern's words stand in a row, or -1.
int last_match(const std::vector<std::string>& words, const std::vector<std::string>& pattern) {
  for (int i = static_cast<int>(words.size()) - static_cast<int>(pattern.size()); i >= 0; --i) {
    bool equal = true;
    for (std::size_t j = 0; j < pattern.size() && equal; ++j) {
      const std::string& word = words[static_cast<std::size_t>(i) + j];
      equal = word == pattern[j] || word == pattern[j] + "s";
    }
    if (equal) return i;
  }
  return -1;
}

}  // namespace

const std::vector<TissuePreset>& tissue_presets() {
  static const std::vector<TissuePreset> presets = make_presets();
  return presets;
}

const TissuePreset* match_preset(const std::string& structure_name) {
  // a match's rank: kind words first, then the place in the name, then the number of words
  struct Rank {
    bool kind = false;
    int place = -1;
    std::size_t length = 0;
    auto operator<=>(const Rank&) const = default;
  };
  const std::vector<std::string> words = words_of(structure_name);
  const TissuePreset* best = nullptr;
  Rank best_rank;
  for (const TissuePreset& preset : tissue_presets()) {
    for (const bool kind : {true, false}) {
      for (const std::string& pattern : kind ? preset.kind_words : preset.structure_names) {
        const std::vector<std::string> pattern_words = words_of(pattern);
        const int first = last_match(words, pattern_words);
        if (first < 0) continue;
        const Rank rank{kind, first + static_cast<int>(pattern_words.size()), pattern_words.size()};
        if (best && rank <= best_rank) continue;
        best = &preset;
        best_rank = rank;
      }
    }
  }
  return best;
}

std::string tissue_preset_table() {
  std::string text =
      "| preset | stiffness N/mm | friction | friction_damping N·s/mm | friction_max N | viscosity N·s/mm | "
      "opacity | source |\n|---|---|---|---|---|---|---|---|\n";
  for (const TissuePreset& preset : tissue_presets()) {
    const TissueSettings& v = preset.values;
    text += "| `" + preset.name + "`";
    for (const double value : {v.stiffness_N_per_mm, v.friction_coefficient, v.friction_damping_N_s_per_mm,
                               v.friction_max_N, v.viscosity_N_s_per_mm, v.opacity})
      text += " | " + number_text(value);
    text += " | " + preset.source + " |\n";
  }
  return text;
}

}  // namespace palpate
