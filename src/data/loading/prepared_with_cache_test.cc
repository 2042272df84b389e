#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "loading/test_loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/recording/recording_source.h"

namespace palpate {
namespace {

using testing::kBone;
using testing::kBoneRadius_mm;
using testing::kCartilage;
using testing::loaded_ball;

constexpr double kShell_mm = 3;

double distance_mm(const Model& model, std::size_t surface, double radius_mm) {
  return model.surfaces[surface].surface->distance_mm(Point<Patient>() +
                                                      Vector<Patient>(0, 0.6, 0.8) * radius_mm);
}

TEST(PreparedWithCache, AdjacentStructuresShareAnOuterSurfaceAndStifferOnesHaveLayers) {
  const auto model = loaded_ball(kShell_mm).model;
  const std::array methods{ForceMethod::kProxy, ForceMethod::kSpline};
  const auto ready = prepared_with_cache(model, methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  EXPECT_TRUE((*ready)->has(ForceMethod::kProxy));
  EXPECT_TRUE((*ready)->has(ForceMethod::kSpline));
  EXPECT_FALSE(model->has(ForceMethod::kProxy));
  EXPECT_EQ((*ready)->content_hash, model->content_hash);
  EXPECT_EQ((*ready)->label_of_surface, (std::vector<LabelId>{kBone, kCartilage})) << "fat is not felt";
  ASSERT_EQ((*ready)->surfaces.size(), 3u) << "those two, and what they have in common";
  for (const std::size_t structure : {0u, 1u})
    EXPECT_EQ((*ready)->surfaces[structure].stiffness_N_per_mm, model->tissues[structure].stiffness_N_per_mm);
  const ContactSurface& bone = (*ready)->surfaces[0];
  const ContactSurface& shell = (*ready)->surfaces[1];
  const ContactSurface& common = (*ready)->surfaces[2];
  EXPECT_EQ(shell.surface, nullptr) << "never gone through, never met by itself";
  EXPECT_EQ(shell.layer, 0);
  EXPECT_EQ(common.layer, 0);
  EXPECT_EQ(common.covered_by, -1);
  EXPECT_EQ(common.lower_N_per_mm, 0);
  EXPECT_EQ(common.upper_N_per_mm, shell.stiffness_N_per_mm);
  EXPECT_EQ(bone.layer, 1);
  EXPECT_EQ(bone.lower_N_per_mm, shell.stiffness_N_per_mm);
  EXPECT_EQ(bone.covered_by, -1);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm), 0, 0.45);
  // the zero level is on the outside of the shell, within half a voxel of 0.9 mm
  EXPECT_NEAR(distance_mm(**ready, 2, kBoneRadius_mm + kShell_mm), 0, 0.45);
  EXPECT_NEAR(distance_mm(**ready, 2, kBoneRadius_mm + kShell_mm + 2), 2, 0.7);
  ASSERT_NE((*ready)->surfaces[2].owners, nullptr);
  const OwnerFractions outside =
      (*ready)->surfaces[2].owners->at(Point<Patient>(0, 0, kBoneRadius_mm + kShell_mm));
  ASSERT_EQ(outside.all().size(), 1u) << "the bone lies beneath";
  EXPECT_EQ(outside.largest(), 1);
  EXPECT_EQ(*prepared_with_cache(*ready, methods), *ready) << "nothing to add";
}

TEST(PreparedWithCache, PuncturableTissueAndItsSupportHaveSeparateSurfaces) {
  Model model = *loaded_ball(kShell_mm).model;
  model.tissues[1].puncture_N = 2;
  const std::array methods{ForceMethod::kProxy};
  const auto ready = prepared_with_cache(std::make_shared<const Model>(model), methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  ASSERT_EQ((*ready)->surfaces.size(), 4u);
  EXPECT_EQ((*ready)->surfaces[1].puncture_N, 2);
  EXPECT_NEAR(distance_mm(**ready, 1, kBoneRadius_mm + kShell_mm), 0, 0.45);
  EXPECT_EQ((*ready)->surfaces[1].covered_by, 2);
  EXPECT_EQ((*ready)->surfaces[2].opened_by, (std::vector<std::int16_t>{1}));
  // contribution of bone to the first layer, and its own layer
  const ContactSurface& first = (*ready)->surfaces[3];
  EXPECT_EQ(first.structure, 0);
  EXPECT_EQ(first.layer, 0);
  EXPECT_EQ(first.covered_by, 2);
  EXPECT_EQ((*ready)->surfaces[0].layer, 1);
  EXPECT_EQ((*ready)->surfaces[0].surface, first.surface);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm + 2), 2, 0.7);
}

// soft, hard and soft again, with more stiffness levels than layers
TEST(PreparedWithCache, LayerCountIsBoundedByTouchableStructures) {
  for (const double factor : {1.05, 1.2, 2.0}) {
    Model model = *loaded_ball(kShell_mm).model;
    GridGeometry grid;
    constexpr int kStructures = 10;
    grid.dims = {12, 12, 3 * kStructures + 6};
    Volume<LabelId> labels(grid);
    model.tissues.resize(1);
    model.tissue_of_label.assign(kStructures + 1, -1);
    const Tissue tissue = model.tissues[0];
    model.tissues.clear();
    for (int n = 0; n < kStructures; ++n) {
      model.tissues.push_back(tissue);
      model.tissues.back().stiffness_N_per_mm = 0.01 * std::pow(factor, n);
      model.tissue_of_label[static_cast<std::size_t>(n) + 1] = static_cast<std::int16_t>(n);
      for (int k = 0; k < 3; ++k)
        for (int j = 3; j < 9; ++j)
          for (int i = 3; i < 9; ++i) labels.at(i, j, 3 + 3 * n + k) = static_cast<LabelId>(n + 1);
    }
    model.labels = label_bricks(labels);
    const std::array methods{ForceMethod::kProxy};
    const auto ready = prepared_with_cache(std::make_shared<const Model>(model), methods);
    ASSERT_TRUE(ready.ok()) << ready.error().message();
    int deepest = 0;
    for (const ContactSurface& surface : (*ready)->surfaces) {
      deepest = std::max(deepest, surface.layer);
      EXPECT_LT(surface.lower_N_per_mm, surface.upper_N_per_mm);
    }
    EXPECT_LT(deepest, kMaxLayers);
    EXPECT_GE(deepest, std::min(kStructures, kMaxLayers) / 2);
    // the layers' contributions of each structure add up to its stiffness
    for (int n = 0; n < kStructures; ++n) {
      const ContactSurface& structure = (*ready)->surfaces[static_cast<std::size_t>(n)];
      double sum = 0;
      for (int layer = 0; layer <= structure.layer; ++layer) {
        const auto of_layer = std::find_if(
            (*ready)->surfaces.begin(), (*ready)->surfaces.end(), [&](const ContactSurface& contact_surface) {
              const Point<Patient> inside(6, 6, 4 + 3 * n);
              return contact_surface.layer == layer && contact_surface.surface != nullptr &&
                     contact_surface.surface->distance_mm(inside) < 0;
            });
        ASSERT_NE(of_layer, (*ready)->surfaces.end()) << n << ", " << layer;
        const double to = layer == structure.layer ? structure.stiffness_N_per_mm : of_layer->upper_N_per_mm;
        sum += to - of_layer->lower_N_per_mm;
      }
      EXPECT_NEAR(sum, structure.stiffness_N_per_mm, 1e-12);
    }
  }
}

TEST(PreparedWithCache, UntouchableTissueHasNoSurface) {
  Model model = *loaded_ball(kShell_mm).model;
  model.tissues[1].touchable = false;
  const std::array methods{ForceMethod::kProxy};
  const auto ready = prepared_with_cache(std::make_shared<const Model>(model), methods);
  ASSERT_TRUE(ready.ok()) << ready.error().message();
  ASSERT_EQ((*ready)->surfaces.size(), 1u);
  EXPECT_EQ((*ready)->surfaces[0].owners, nullptr);
  EXPECT_EQ((*ready)->surfaces[0].covered_by, -1);
  EXPECT_NEAR(distance_mm(**ready, 0, kBoneRadius_mm), 0, 0.45);
}

TEST(PreparedWithCache, ASimulatedHandIsHeldByTheProxyAndItReplays) {
  const LoadedScene loaded = loaded_ball(3);
  test::TemporaryFolder folder;
  SimulationOptions options;
  options.method = ForceMethod::kProxy;
  const auto result = simulate(loaded, testing::press_script("shell"), options, folder / "proxy.h5");
  ASSERT_TRUE(result.ok()) << result.error().message();
  EXPECT_TRUE(result->problems.empty()) << result->problems.front();
  ASSERT_EQ(result->holds.size(), 1u);
  EXPECT_GT(result->holds[0].held_s, 0.5);
  EXPECT_EQ(result->summary.inside, 0u);
  const auto recording = read_recording(folder / "proxy.h5");
  ASSERT_TRUE(recording.ok());
  const auto again = replay(*recording, loaded.model);
  ASSERT_TRUE(again.ok()) << again.error().message();
  EXPECT_TRUE(again->identical) << again->difference;
}

}  // namespace
}  // namespace palpate
