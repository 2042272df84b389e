#include <algorithm>
#include <array>
#include <initializer_list>
#include <string>
#include <vector>

#include "palpate/contact/tissue_values.h"
#include "palpate/scene/named_values.h"
#include "palpate/scene/scene.h"
#include "scene/scene_tables.h"

namespace palpate {
namespace {

using enum KeyType;

// Identification of a tissue, and of its voxels.
std::vector<KeySpec> source_keys() {
  return {
      {.name = "name", .type = kText, .meaning = "Unique in the scene; `rests_on` refers to it. Required."},
      {.name = "preset",
       .type = kChoice,
       .choices = {"bone", "cartilage", "meniscus", "disc", "ligament", "muscle", "fat", "skin", "vessel",
                   "nerve", "liver", "kidney", "spleen", "lung", "heart", "brain", "gland", "lymph node",
                   "tumour"},
       .meaning = "Initial values ([presets.md](presets.md))."},
      {.name = "labels",
       .type = kLabels,
       .min = 1,
       .max = 65535,
       .meaning = "The structures, by exact name or by number. A name selects every structure with "
                  "that name; no structure belongs to two tissues."},
      {.name = "optional",
       .type = kFlag,
       .default_text = "false",
       .meaning = "`true`: labels missing from the map are ignored instead of being an error."},
      {.name = "threshold",
       .type = kInterval,
       .unit = "the scan's unit",
       .min = -1e9,
       .max = 1e9,
       .meaning = "`[low, high]` on the raw scan, without labels: the structure is every voxel at or "
                  "above their mean. For the union Gaussian the weight is 0 at or below `low`, 1 at or "
                  "above `high`, and linear between."},
      {.name = "embedding",
       .type = kFlag,
       .default_text = "false",
       .meaning = "`true`: the tissue consists of the unlabelled voxels inside the body, so that "
                  "organs are embedded in it. The body is the labelled region, the part of the scan "
                  "connected to it above `air_below`, and everything enclosed by them in space or in "
                  "an axial slice. At most one tissue."},
      {.name = "air_below",
       .type = kNumber,
       .unit = "the scan's unit",
       .min = -1e9,
       .max = 1e9,
       .meaning = "For an embedding: scan value that separates air from the body. Default: only voxels "
                  "enclosed by labels are inside."}};
}

// All contact properties. Their defaults are those of ContactProperties.
std::vector<KeySpec> contact_property_keys() {
  static const auto kDefaults = [] {
    std::array<std::string, kContactProperties.size()> texts;
    for (std::size_t n = 0; n < texts.size(); ++n)
      texts[n] = number_text(ContactProperties{}.*kContactProperties[n].value);
    return texts;
  }();
  std::vector<KeySpec> keys;
  for (std::size_t n = 0; n < kContactProperties.size(); ++n) {
    const ContactProperty& property = kContactProperties[n];
    // static friction follows the scene's friction
    const bool has_default = property.value != &ContactProperties::static_friction;
    keys.push_back({.name = property.key,
                    .type = kNumber,
                    .default_text = has_default ? kDefaults[n] : std::string_view(),
                    .unit = property.unit,
                    .min = property.range.min,
                    .max = property.range.max,
                    .meaning = property.about});
  }
  return keys;
}

std::vector<KeySpec> touchable_keys() {
  return {{.name = "touchable",
           .type = kFlag,
           .default_text = "true",
           .meaning = "`false`: displayed only, without contact."}};
}

// Puncture, and removal by a burr.
std::vector<KeySpec> puncture_and_cutting_keys() {
  return {{.name = "puncture",
           .type = kNumber,
           .unit = "N",
           .min = 0.05,
           .max = 40,
           .meaning = "For the proxy: force at which the tool punctures the surface. Default: never."},
          {.name = "after_puncture",
           .type = kChoice,
           .default_text = "\"closes\"",
           .choices = {"closes", "stays_open"},
           .meaning = "For a tissue with `puncture`. `closes`: the tissue closes behind the tool, and the "
                      "next puncture needs the force again. `stays_open`: a tool that is not wider passes "
                      "there without force."},
          {.name = "cutting_energy",
           .type = kNumber,
           .default_text = "100",
           .unit = "mJ/mm³",
           .min = 1,
           .max = 10000,
           .meaning = "For a burr: work of its motor to remove a cubic millimetre. For a shaver the "
                      "default for tissue with a modulus is 5."},
          {.name = "protection",
           .type = kChoice,
           .default_text = "\"none\"",
           .choices = {"none", "alarm", "keep"},
           .meaning = "Protection from a burr. `alarm`: cutting it raises an alarm. `keep`: the burr "
                      "cannot enter it."}};
}

// Parameters of the deformable laws.
std::vector<KeySpec> elastic_keys() {
  return {{.name = "youngs_modulus",
           .type = kNumber,
           .unit = "kPa",
           .min = kElasticModulusRange.min_kPa,
           .max = kElasticModulusRange.max_kPa,
           .meaning = "Young's modulus for `[yielding] law = \"elastic\"`, `\"neo-hookean\"` and "
                      "`\"exponential\"`, without effect under another law. A tissue without a modulus, "
                      "its own or its preset's, is rigid, "
                      "such as bone."},
          {.name = "poissons_ratio",
           .type = kNumber,
           .default_text = "0.45",
           .min = 0,
           .max = kMaxPoissonsRatio,
           .meaning = "Poisson's ratio for the same laws: lateral expansion under compression; near 0.5 "
                      "the volume is preserved. Requires a modulus, the tissue's own or the preset's."},
          {.name = "stiffening",
           .type = kNumber,
           .default_text = "0",
           .min = 0,
           .max = kMaxStiffening,
           .meaning = "For `law = \"exponential\"`: exponent b of Fung's law, by which stress grows with "
                      "exp(b (I1 - 3)), I1 - 3 being about three times the squared strain. 0: as "
                      "`\"neo-hookean\"`. Requires a modulus, the tissue's own or the preset's."},
          {.name = "relaxation",
           .type = kTerms,
           .unit = "s",
           .min = kRelaxationTimeRange.min_s,
           .max = kRelaxationTimeRange.max_s,
           .meaning = "Stress relaxation for the same laws: one or two pairs of the fraction of the "
                      "modulus that relaxes, with a sum below 1, and the time constant. The modulus is "
                      "then the instantaneous one. Default, and with `[]`: no relaxation, but see "
                      "`[yielding] relaxation`. Requires a modulus."}};
}

// Friction of the direct methods, appearance and support.
std::vector<KeySpec> remaining_keys() {
  return {{.name = "friction_damping",
           .type = kNumber,
           .default_text = "0.005",
           .unit = "N·s/mm",
           .min = 0,
           .max = 0.1,
           .meaning = "For the direct methods: tangential force per mm/s, below its two limits "
                      "(`friction`, `friction_max`)."},
          {.name = "friction_max",
           .type = kNumber,
           .default_text = "0.5",
           .unit = "N",
           .min = 0,
           .max = 10,
           .meaning = "For the direct methods: absolute limit of the tangential force."},
          {.name = "colour",
           .type = kColour,
           .meaning = "`\"#rrggbb\"`. Default: that of the preset; without one those of the "
                      "structures."},
          {.name = "opacity",
           .type = kNumber,
           .default_text = "1",
           .min = 0,
           .max = 1,
           .meaning = "In pictures: 0 invisible, 1 solid."},
          {.name = "rests_on",
           .type = kNames,
           .default_text = "[]",
           .meaning = "Tissues of this scene that support this one. They must be touchable and at least as "
                      "stiff."}};
}

}  // namespace

TableSpec tissue_table() {
  TableSpec table{
      "[[tissue]]",
      "A group of structures that feel alike, defined by one of `labels`, `threshold` and `embedding`. "
      "A preset gives initial values, which other keys override; the defaults below apply without a "
      "preset. A tissue may not be stiffer than one that it rests on, nor rest on one that is not "
      "touchable: "
      "the force at their border would point inward.",
      {}};
  for (const auto& keys : {source_keys(), touchable_keys(), contact_property_keys(),
                           puncture_and_cutting_keys(), elastic_keys(), remaining_keys()})
    table.keys.insert(table.keys.end(), keys.begin(), keys.end());
  return table;
}

TableSpec deformation_table() {
  return {"[yielding]",
          "Deformation of soft tissue. With layers nothing moves, and each structure pushes the "
          "tool out with its `stiffness`. An elastic body dents, spreads sideways, and is harder "
          "above hard structures. It uses `youngs_modulus`; rigid tissue uses "
          "`stiffness` ([tissue.md](../concepts/tissue.md)).",
          {{.name = "law",
            .type = kChoice,
            .default_text = "\"layers\"",
            .choices = names_of(kTissueLaws),
            .meaning = "`elastic`: tissues with a `youngs_modulus` yield. `neo-hookean`: the same, "
                       "but they stiffen under large strain; solving a frame takes twice the "
                       "processor time. `exponential`: the same, and tissues with a `stiffening` "
                       "stiffen by it. All three require the proxy. `chainmail`: contact as with "
                       "layers, with a displayed deformation by the chain mail of Gibson 1997."},
           {.name = "cell",
            .type = kNumber,
            .unit = "mm",
            .min = 0.2,
            .max = 10,
            .meaning = "For all laws but `layers`: edge of the cubic cells of the solver. Default: "
                       "the smallest voxel spacing, at least 0.8 and at most 3; up to twice as much "
                       "for a tool with a radius of more than 10 voxels."},
           {.name = "relaxation",
            .type = kFlag,
            .default_text = "false",
            .meaning = "For the three elastic laws. `true`: tissues without a `relaxation` of their own "
                       "use that of their preset. `false`: they do not relax."}}};
}

TableSpec density_table() {
  return {"[density]",
          "For a burr. In a calibrated CT every voxel of touchable tissue without a modulus, such as "
          "bone, has the `cutting_energy` of its tissue times the square of HU / `full`. This ratio is "
          "limited to 0.1 to 1.25 ([burr.md](../guide/burr.md#density)).",
          {{.name = "calibrated",
            .type = kFlag,
            .default_text = "false",
            .meaning = "`true`: the scan is a CT in calibrated Hounsfield units, and energies follow it. A "
                       "cone-beam CT is not calibrated. `false`: energies depend on the tissue alone."},
           {.name = "full",
            .type = kNumber,
            .default_text = "1700",
            .unit = "HU",
            .min = 200,
            .max = 4000,
            .meaning = "Attenuation of bone that takes the whole `cutting_energy`. The default is that of "
                       "cortical bone of 1.9 g/cm³."}}};
}

}  // namespace palpate
