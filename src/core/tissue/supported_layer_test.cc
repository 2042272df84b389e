#include "tissue/supported_layer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <vector>

#include "contact/test_layer_oracle.h"
#include "palpate/tissue/carving.h"
#include "palpate/tissue/soft_tissue_solver.h"
#include "tissue/test_layer_scenes.h"

namespace palpate {
namespace {

using testing::layer_block;
using testing::layer_pressed;
using testing::LayerOracle;
using testing::LayerScene;

std::optional<SupportedLayer> measured(const Model& model, const Point<Patient>& at, double max_mm = 12) {
  return supported_layer(carved_labels(model), materials_of(model), at, Vector<Patient>(0, 0, 1), 1.5,
                         max_mm);
}

TEST(SupportedLayer, ThicknessEqualsThatOfTheVoxels) {
  for (const double thickness_mm : {1.0, 2.0, 3.0, 5.0, 10.0}) {
    LayerScene scene;
    scene.thickness_mm = thickness_mm;
    const auto layer = measured(*layer_block(scene), {0.2, -0.3, 0});
    ASSERT_TRUE(layer) << thickness_mm;
    EXPECT_NEAR(layer->thickness_mm, thickness_mm, 0.07);
    EXPECT_EQ(layer->material.youngs_modulus_kPa, scene.modulus_kPa);
  }
}

TEST(SupportedLayer, IsEmptyForThickMixedOrUnsupportedTissue) {
  LayerScene scene;
  scene.thickness_mm = 8;
  EXPECT_FALSE(measured(*layer_block(scene), {0, 0, 0}, 6));
  // in the air, and outside the volume
  EXPECT_FALSE(measured(*layer_block(scene), {0, 0, 10}));
  EXPECT_FALSE(measured(*layer_block(scene), {500, 0, 0}));
  scene.skin_mm = 2;
  EXPECT_FALSE(measured(*layer_block(scene), {0, 0, 0}));
  scene.skin_modulus_kPa = 1.1 * scene.modulus_kPa;
  EXPECT_TRUE(measured(*layer_block(scene), {0, 0, 0}));
  scene.base = false;
  EXPECT_FALSE(measured(*layer_block(scene), {0, 0, 0}));
}

TEST(SupportedLayer, TrimmedLayerIsThinner) {
  LayerScene scene;
  scene.thickness_mm = 4;
  const auto whole = layer_block(scene);
  std::vector<Cut> cuts;
  for (double down_mm = 1; down_mm <= 2; down_mm += 1)
    cuts.push_back({0, {{-15, -15, 2 - down_mm}, {15, -15, 2 - down_mm}, 2, 0, {0, 30, 0}, 2}});
  const auto layer = measured(*Carving(*whole).with(cuts)->applied_to(*whole), {0, 0, -2});
  ASSERT_TRUE(layer);
  EXPECT_NEAR(layer->thickness_mm, 2, 0.1);
}

TEST(DeepBase, IsTheMeanOverRaysThatReachIt) {
  LayerScene scene;
  scene.thickness_mm = 10;
  scene.skin_mm = 2;
  const auto base_per_mm = [](const Model& model, const Point<Patient>& at, double min_mm, double max_mm) {
    return mean_inverse_base_depth_per_mm(carved_labels(model), materials_of(model), at,
                                          Vector<Patient>(0, 0, 1), min_mm, max_mm);
  };
  const auto model = layer_block(scene);
  EXPECT_NEAR(base_per_mm(*model, {0, 0, 0}, 5, 80), 0.1, 0.003) << "whatever the soft tissue above it";
  EXPECT_EQ(base_per_mm(*model, {0, 0, 0}, 11, 80), 0);
  EXPECT_EQ(base_per_mm(*model, {0, 0, 0}, 5, 9), 0);
  // three of nine rays end beside the block
  EXPECT_NEAR(base_per_mm(*model, {17, 0, 0}, 5, 80), 0.1 * 6 / 9, 0.003);
  EXPECT_EQ(base_per_mm(*model, {500, 0, 0}, 5, 80), 0);
  scene.base = false;
  EXPECT_EQ(base_per_mm(*layer_block(scene), {0, 0, 0}, 5, 80), 0);
}

// Force of the settled solution by which the tick renders a layer, beside the exact one of the layer.
TEST(SoftTissueSolver, LayerForceMatchesTheExactSolution) {
  for (const double cell_mm : {1.0, 2.0})
    for (const double poissons_ratio : {0.3, 0.45, 0.49}) {
      if (cell_mm > 1 && poissons_ratio != 0.45) continue;
      const LayerOracle oracle(poissons_ratio);
      for (const double thickness_mm : {2.0, 3.0, 5.0, 10.0, 20.0}) {
        LayerScene scene;
        scene.thickness_mm = thickness_mm;
        scene.poissons_ratio = poissons_ratio;
        scene.cell_mm = cell_mm;
        for (const double radius_mm : {1.5, 3.0, 8.0}) {
          scene.tool_mm = radius_mm;
          const auto model = layer_block(scene);
          SoftTissueSolver solver;
          for (const double part : {0.1, 0.3, 0.5}) {
            const double depth_mm = part * thickness_mm;
            double force_N = 0;
            for (int n = 0; n < 6; ++n) {
              const auto& local = solver.solve(*model, layer_pressed(depth_mm, force_N)).local_compliance[0];
              ASSERT_TRUE(local.is_known());
              force_N = soft_contact_force(contact_law_of(local), depth_mm, radius_mm).force_N;
            }
            const double modulus = 1e-3 * scene.modulus_kPa / (1 - poissons_ratio * poissons_ratio);
            const double exact_N =
                oracle.at_depth(radius_mm / thickness_mm, part).force * modulus * thickness_mm * thickness_mm;
            EXPECT_NEAR(force_N / exact_N, 1, part <= 0.3 ? 0.1 : 0.15)
                << cell_mm << " " << poissons_ratio << " " << thickness_mm << " " << radius_mm << " " << part;
          }
        }
      }
    }
}

}  // namespace
}  // namespace palpate
