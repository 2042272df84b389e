// Scenes that are proposed for label maps: order of the rendered forces, and colours.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "base/test_files.h"
#include "palpate/contact/colours.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/loading/loading.h"
#include "palpate/scene/new_scene.h"
#include "palpate/scene/scene.h"
#include "palpate/scene/tissue_presets.h"
#include "palpate/servo/servo.h"
#include "palpate/volume_io/volume_io.h"

namespace palpate {
namespace {

/// Presets in the order in which a probe finds them, from the stiffest on.
constexpr std::array kOrder{"bone", "cartilage", "ligament", "muscle", "fat"};
constexpr int kPitch_voxels = 14, kBlock_voxels = 10;

/// A block of 10 x 10 x 10 mm of each preset, in a row along x, with its upper face at z = 12.5 mm.
LabelMap a_block_of_each_preset() {
  const auto& presets = tissue_presets();
  GridGeometry grid;
  grid.dims = {kPitch_voxels * static_cast<int>(presets.size()), kPitch_voxels, 20};
  LabelMap map;
  map.layers.emplace_back(grid);
  for (std::size_t n = 0; n < presets.size(); ++n) {
    const auto id = static_cast<LabelId>(n + 1);
    for (int k = 3; k < 3 + kBlock_voxels; ++k)
      for (int j = 2; j < 2 + kBlock_voxels; ++j)
        for (int i = 2; i < 2 + kBlock_voxels; ++i)
          map.layers[0].at(static_cast<int>(n) * kPitch_voxels + i, j, k) = id;
    map.segments.push_back({id, presets[n].name, Rgb{1, 2, 3}, 0, id});
  }
  return map;
}

/// Force of each preset at a depth, N: the tip descends onto the middle of each block's upper face.
std::map<std::string, double> forces_at(const Model& model, double depth_mm) {
  constexpr double kFace_mm = 12.5, kPerTick_mm = 0.02;
  std::map<std::string, double> forces;
  for (std::size_t n = 0; n < tissue_presets().size(); ++n) {
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    SessionState state;
    TickRecord record;
    Wrench wrench;
    const double x = kPitch_voxels * static_cast<double>(n) + 2 + 0.5 * (kBlock_voxels - 1);
    for (double z = kFace_mm + 4 + model.tools[0].radius_mm; z >= kFace_mm - depth_mm; z -= kPerTick_mm) {
      const DeviceState device{.tip = model.X_WorldPatient * Point<Patient>(x, 6.5, z)};
      tick(model, parameters, std::span(&device, 1), 1e-3, state, std::span(&wrench, 1), record);
    }
    forces[tissue_presets()[n].name] = record.device[0].contact_N[0];
  }
  return forces;
}

/// Force of a tissue alone on a probe of 3 mm, N: a layer's spring or an elastic half-space.
double force_of(const Tissue& tissue, const Model& model, double depth_mm) {
  if (!model.is_deformable(tissue)) return tissue.stiffness_N_per_mm * depth_mm;
  ContactLaw law;
  law.modulus_N_per_mm2 = contact_modulus_N_per_mm2(*tissue.elastic);
  return soft_contact_force(law, depth_mm, 1.5, max_deformable_stiffness_N_per_mm(model)).force_N;
}

TEST(ProposedOrder, OfAllPresetsHoldsInEveryDepthAndTheColoursAreTheirs) {
  const test::TemporaryFolder folder;
  const auto file = folder / "presets.seg.nrrd";
  ASSERT_TRUE(write_labels(file, a_block_of_each_preset()).ok());
  const auto loaded = load_scene_or_data_set({file.string()});
  ASSERT_TRUE(loaded.ok()) << loaded.error().message();
  ASSERT_EQ(loaded->scene.tissues.size(), tissue_presets().size());
  ASSERT_EQ(loaded->scene.deformation.law, TissueLaw::kElastic);
  for (const TissuePreset& preset : tissue_presets())
    EXPECT_EQ(colour_of(*loaded->model, loaded->model->find(preset.name)->id), *preset.values.colour)
        << preset.name << ": not the colour in the file";
  constexpr std::array kMethods{ForceMethod::kProxy};
  const auto model = prepared_with_cache(loaded->model, kMethods);
  ASSERT_TRUE(model.ok()) << model.error().message();
  for (const double depth_mm : {0.25, 0.5, 1.0, 2.0, 3.0}) {
    const std::map<std::string, double> forces = forces_at(**model, depth_mm);
    for (std::size_t n = 1; n < kOrder.size(); ++n)
      EXPECT_GE(forces.at(kOrder[n - 1]), forces.at(kOrder[n]) * (1 - 1e-6))
          << kOrder[n - 1] << " and " << kOrder[n] << " at " << depth_mm << " mm";
    for (const auto& [name, force_N] : forces) {
      // deeper than the discretisation of the surface, every block is in contact
      if (depth_mm >= 0.5) {
        EXPECT_GT(force_N, 0) << name << " at " << depth_mm << " mm";
      }
      EXPECT_LE(force_N, forces.at("bone") * (1 + 1e-6)) << name << " at " << depth_mm << " mm";
    }
  }
}

// structures without a preset have colours of their own, apart from each other and from every preset's
TEST(ProposedOrder, StructuresWithoutAPresetHaveDistinctColours) {
  std::vector<std::pair<std::string, std::string>> fields;
  constexpr int kStructures = 40;
  for (int n = 0; n < kStructures; ++n) {
    const std::string key = "Segment" + std::to_string(n) + "_";
    fields.insert(fields.end(), {{key + "ID", "x"},
                                 {key + "Name", "x"},
                                 {key + "Layer", "0"},
                                 {key + "LabelValue", std::to_string(n + 1)}});
  }
  const auto segments = parse_segment_fields(fields, 1, "test");
  ASSERT_TRUE(segments.ok()) << segments.error().message();
  const auto distance = [](const Rgb& a, const Rgb& b) {
    return std::hypot(a.r - b.r, a.g - b.g, a.b - b.b);
  };
  for (std::size_t a = 0; a < segments->size(); ++a) {
    for (std::size_t b = 0; b < a; ++b)
      EXPECT_GT(distance((*segments)[a].colour, (*segments)[b].colour), 15) << a << " and " << b;
    for (const TissuePreset& preset : tissue_presets())
      EXPECT_GT(distance((*segments)[a].colour, *preset.values.colour), 40) << a << " and " << preset.name;
  }
}

class OrderOf : public ::testing::TestWithParam<const char*> {};

TEST_P(OrderOf, SharedDataHoldsAndTheColoursAreThePresets) {
  PALPATE_SHARED_FILE(file, GetParam());
  const auto labels = read_labels(file);
  ASSERT_TRUE(labels.ok()) << labels.error().message();
  const auto text = new_scene_text({.labels = file, .label_map = &labels->labels}, "");
  ASSERT_TRUE(text.ok()) << text.error().message();
  const auto scene = parse_scene(*text, "proposed");
  ASSERT_TRUE(scene.ok()) << scene.error().message();
  Model model;
  model.tissue_law = scene->deformation.law;
  std::map<std::string, Tissue> tissues;
  for (const TissueSettings& settings : scene->tissues) {
    const TissuePreset* preset = find_preset(settings.preset);
    EXPECT_EQ(settings.colour, preset != nullptr ? preset->values.colour : std::nullopt) << settings.name;
    if (!settings.touchable) continue;
    Tissue tissue;
    static_cast<TissueProperties&>(tissue) = settings;
    tissues[settings.preset] = tissue;
    model.tissues.push_back(tissue);
  }
  ASSERT_FALSE(tissues.empty());
  for (const double depth_mm : {0.25, 0.5, 1.0, 2.0, 3.0}) {
    double stiffer_N = HUGE_VAL;
    for (const char* preset : kOrder) {
      const auto found = tissues.find(preset);
      if (found == tissues.end()) continue;
      const double force_N = force_of(found->second, model, depth_mm);
      EXPECT_LE(force_N, stiffer_N * (1 + 1e-9)) << preset << " at " << depth_mm << " mm";
      stiffer_N = force_N;
    }
  }
}

INSTANTIATE_TEST_SUITE_P(Files, OrderOf,
                         ::testing::Values("knee_spl/seg.nrrd",
                                           "knee_dess/SAG_3D_DESS_RIGHT_bones_cart_men_fib-label.nrrd",
                                           "torso_ct/example_seg.nii.gz", "dicom_seg/liver_seg.nrrd"),
                         [](const auto& file) {
                           const std::string path = file.param;
                           return path.substr(0, path.find('/'));
                         });

}  // namespace
}  // namespace palpate
