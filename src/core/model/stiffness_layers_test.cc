#include "palpate/model/stiffness_layers.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>

#include "base/test_seed.h"

namespace palpate {
namespace {

TEST(StiffnessLayers, MergeImperceptibleDifferences) {
  EXPECT_TRUE(stiffness_layers({}).empty());
  const auto layers = stiffness_layers({1.5, 0.036, 0.9, 1.45, 0.036});
  ASSERT_EQ(layers.size(), 3u);
  EXPECT_EQ(layers[0].max_N_per_mm, 0.036);
  EXPECT_EQ(layers[1].min_N_per_mm, 0.9);
  EXPECT_EQ(layers[2].min_N_per_mm, 1.45);
  EXPECT_EQ(layers[2].max_N_per_mm, 1.5);
}

TEST(StiffnessLayers, MergeTheClosestBeyondTheMaximum) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> exponent(-4, 1);
  for (int round = 0; round < 200; ++round) {
    std::vector<double> stiffnesses(7);
    for (double& stiffness : stiffnesses) stiffness = std::exp(exponent(random));
    const int largest = 1 + static_cast<int>(random() % 7);
    const auto layers = stiffness_layers(stiffnesses, largest);
    ASSERT_LE(layers.size(), static_cast<std::size_t>(largest));
    for (const double stiffness : stiffnesses)
      ASSERT_EQ(std::count_if(layers.begin(), layers.end(),
                              [&](const StiffnessRange& layer) {
                                return stiffness >= layer.min_N_per_mm && stiffness <= layer.max_N_per_mm;
                              }),
                1);
    for (std::size_t n = 1; n < layers.size(); ++n)
      ASSERT_GT(layers[n].min_N_per_mm, layers[n - 1].max_N_per_mm);
    double worst = 0;
    for (const StiffnessRange& layer : layers) worst = std::max(worst, layer.error());
    if (layers.size() < static_cast<std::size_t>(largest) || largest == 7) {
      ASSERT_LE(worst, 1 - 1 / kSameStiffness);
    }
  }
}

TEST(StiffnessLayers, MergingOneLayerStaysWithinItsError) {
  std::vector<double> twelve;
  for (int n = 0; n < kMaxLayers; ++n) twelve.push_back(0.03 * std::pow(1.4, n));
  for (const StiffnessRange& layer : stiffness_layers(twelve)) EXPECT_EQ(layer.error(), 0);
  twelve.push_back(0.0315 * 1.4);
  const auto layers = stiffness_layers(twelve);
  EXPECT_EQ(layers.size(), static_cast<std::size_t>(kMaxLayers));
  EXPECT_LE(layers[1].error(), 0.05);
}

}  // namespace
}  // namespace palpate
