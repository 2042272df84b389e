#include "scene/elastic_presets.h"

#include <algorithm>
#include <string>

#include "palpate/scene/tissue_presets.h"
#include "scene/keys.h"

namespace palpate {
namespace {

constexpr std::string_view kAsLiver = "(E): the exponent of liver, whose parenchyma and capsule are alike";
// E is from the source of the stiffness, to two digits, unless noted otherwise
constexpr std::array kElasticPresets{
    ElasticPreset{"cartilage",
                  {770, 0.1},
                  {480, 1580},
                  "at equilibrium; range from H_A of 0.48 to 1.58 MPa at five sites of a tibia, with nu 0 to "
                  "0.05 (PMC2858459). Under fast loading it is several times stiffer"},
    ElasticPreset{"meniscus",
                  {120, 0},
                  {100, 160},
                  "at equilibrium, across its fibres; range from the means of its parts, same source. Along "
                  "them it is up to a thousand times stiffer, which an isotropic body cannot represent"},
    ElasticPreset{"disc", {990, 0.1}, {500, 2000}, "at equilibrium; range (E)"},
    ElasticPreset{
        "ligament",
        {96, 0.45},
        {75, 120},
        "across its fibres, the direction of palpation; range from mu of 25 to 39 kPa, same source. Along "
        "them it is stiffer by orders of magnitude (tangent modulus of the medial collateral ligament 332 "
        "MPa; "
        "Quapp, Weiss 1998, J Biomech Eng 120:757), which an isotropic body cannot represent"},
    ElasticPreset{
        "muscle",
        {14, 0.45},
        {5, 19},
        "3.9 to 6.2 kPa of shear modulus; from 5 kPa on (E). A linear body of 18 kPa describes 213 "
        "probes of meat within 1.5 %, so that it has no stiffening ([outside](../results/outside.md))"},
    ElasticPreset{"fat", {9.1, 0.45}, {1, 25}, "range (E)"},
    ElasticPreset{
        "skin",
        {130, 0.45},
        {41, 220},
        "range: one standard deviation, same source. Skin of the breast by suction 56 kPa (Briot et "
        "al. 2022, Clin Biomech 99:105743)"},
    ElasticPreset{"vessel",
                  {12, 0.45},
                  {6, 24},
                  "(E) of a solid body that deforms as much under the probe as the tube does. Labels include "
                  "the blood, and the wall's 771 kPa would be far too stiff"},
    ElasticPreset{
        "nerve",
        {39, 0.45, 1.5},
        {19, 77},
        "range (E)",
        {0, 2.3},
        "alpha = 6.5 of the same source, by equal energy in simple shear of 0.6; range: in compression "
        "and in tension by 30 to 40 %"},
    ElasticPreset{
        "liver",
        {6.3, 0.45, 15},
        {5.4, 6.3},
        "range from a shear modulus of 1.8 kPa elsewhere (doi 10.1088/1361-6560/ab5010)",
        {15, 50},
        "418 probes of pig liver with a sphere of 4 mm, whose force grows e-fold per mm "
        "([outside](../results/outside.md)). 15 with E of 5.4 kPa on a plate at 15 mm, 50 with 3 kPa at "
        "25 mm: the thickness was not recorded"},
    ElasticPreset{
        "kidney",
        {5, 0.45, 15},
        {2.5, 15},
        "to a shear modulus of 4.9 kPa by MR elastography at 45 Hz (Rouviere et al. 2011, J Magn Reson "
        "Imaging 34:880); from (E)",
        {0, 50},
        kAsLiver},
    ElasticPreset{"spleen",
                  {2.9, 0.45, 15},
                  {1.5, 11},
                  "to a shear stiffness of 3.565 kPa by MR elastography at 60 Hz (Mannelli et al. 2010, AJR "
                  "195:387); from (E)",
                  {0, 50},
                  kAsLiver},
    ElasticPreset{"lung", {3.4, 0.4}, {1.7, 7}, "range (E); nu (E), lower than elsewhere because of the air"},
    ElasticPreset{"heart", {3.4, 0.45}, {1.7, 7}, "at rest; range (E)"},
    ElasticPreset{"brain", {1.9, 0.45}, {1.5, 4.5}, "range (E), from shear moduli of 0.5 to 1.5 kPa"},
    ElasticPreset{"gland", {11, 0.45}, {4.8, 11}, "range: pancreas to submandibular gland, same source"},
    ElasticPreset{"lymph node", {21, 0.45}, {10, 43}, "range (E)"},
    ElasticPreset{"tumour",
                  {43, 0.45},
                  {43, 69},
                  "range from a shear modulus of 23 kPa of liver cancer (doi 10.1088/1361-6560/ab5010)"}};

/// Relaxation of a preset, where measured. Slow measurements give no instantaneous part.
struct RelaxationPreset {
  std::string_view preset;
  Relaxation relaxation;
  std::string_view range, source;
};
// midpoints of both ranges; the geometric mean for times
constexpr Relaxation kLimb{{{{0.15, 0.7}, {}}}};
constexpr std::string_view kLimbRange = "fraction 0.03 … 0.28, time 0.05 … 8.9 s";
constexpr std::array kRelaxationPresets{
    RelaxationPreset{
        "muscle", kLimb, kLimbRange,
        "Zheng, Mak 1999, J Biomech Eng 121:330. Indentation of the lower limb in vivo, skin, fat "
        "and muscle together, eight subjects, four sites, three postures. Pig's muscle by itself "
        "lost half when it was compressed (Van Loocke, Lyons, Simms 2008, J Biomech 41:1555)"},
    RelaxationPreset{"fat", kLimb, kLimbRange, "the same limbs"},
    RelaxationPreset{"skin", kLimb, kLimbRange,
                     "the same limbs. Skin of mice by itself lost 0.53 to 0.72 in 0.2 to 1.9 s when it was "
                     "compressed (Wang et al. 2015, PLoS ONE 10:e0120897)"}};

}  // namespace

const ElasticPreset* elastic_preset(std::string_view preset) {
  const auto found = std::find_if(kElasticPresets.begin(), kElasticPresets.end(),
                                  [&](const ElasticPreset& elastic) { return elastic.preset == preset; });
  return found == kElasticPresets.end() ? nullptr : &*found;
}

const Relaxation* measured_relaxation(std::string_view preset) {
  const auto found = std::ranges::find(kRelaxationPresets, preset, &RelaxationPreset::preset);
  return found == kRelaxationPresets.end() ? nullptr : &found->relaxation;
}

std::string elastic_preset_table() {
  std::string text =
      "| preset | E kPa | nu | range of E kPa | from | stiffening | its range | from |\n"
      "|---|---|---|---|---|---|---|---|\n";
  for (const TissuePreset& preset : tissue_presets()) {
    const ElasticPreset* elastic = elastic_preset(preset.name);
    if (elastic == nullptr) {
      text += "| `" + preset.name + "` | — | — | — | rigid | — | — | |\n";
      continue;
    }
    const auto& [low_kPa, high_kPa] = elastic->range_kPa;
    text += "| `" + preset.name + "` | " + number_text(elastic->constants.youngs_modulus_kPa) + " | " +
            number_text(elastic->constants.poissons_ratio) + " | " + number_text(low_kPa) + " … " +
            number_text(high_kPa) + " | " + std::string(elastic->source) + " | " +
            number_text(elastic->constants.stiffening);
    const auto& [low, high] = elastic->stiffening_range;
    text += elastic->stiffening_source.empty() ? " | — | |\n"
                                               : " | " + number_text(low) + " … " + number_text(high) +
                                                     " | " + std::string(elastic->stiffening_source) + " |\n";
  }
  return text;
}

std::string relaxation_preset_table() {
  std::string text = "| preset | relaxation | range | from |\n|---|---|---|---|\n";
  for (const RelaxationPreset& preset : kRelaxationPresets) {
    text += "| `" + std::string(preset.preset) + "` | `[";
    for (const RelaxationTerm& term : preset.relaxation.term)
      if (term.fraction > 0)
        text += (text.back() == '[' ? "[" : ", [") + number_text(term.fraction) + ", " +
                number_text(term.time_s) + "]";
    text += "]` | " + std::string(preset.range) + " | " + std::string(preset.source) + " |\n";
  }
  return text;
}

}  // namespace palpate
