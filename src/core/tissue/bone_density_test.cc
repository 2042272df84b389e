#include "palpate/tissue/bone_density.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <memory>
#include <random>

#include "base/test_seed.h"
#include "palpate/tissue/cutting_energy.h"

namespace palpate {
namespace {

constexpr double kDense_HU = 1700;
constexpr LabelId kRigid = 1;
constexpr int kLabels = 3;

TEST(BoneDensity, TheRatioIsTheSquareWithinItsRange) {
  EXPECT_EQ(density_ratio(kDense_HU, kDense_HU), 1);
  EXPECT_DOUBLE_EQ(density_ratio(0.5 * kDense_HU, kDense_HU), 0.25);
  EXPECT_DOUBLE_EQ(density_ratio(-1000, kDense_HU), 0.01);
  EXPECT_DOUBLE_EQ(density_ratio(0.1 * kDense_HU, kDense_HU), 0.01);
  EXPECT_DOUBLE_EQ(density_ratio(3000, kDense_HU), 1.5625);
  EXPECT_EQ(density_ratio(std::numeric_limits<double>::quiet_NaN(), kDense_HU), 1);
  for (double HU = -1000; HU < 3000; HU += 10)
    EXPECT_LE(density_ratio(HU, kDense_HU), density_ratio(HU + 10, kDense_HU));
}

// bone, soft tissue with a modulus, and tissue that is not felt, with a random scan
Model randomly_scanned(std::mt19937& random) {
  GridGeometry grid;
  grid.dims = {7, 6, 5};
  Volume<LabelId> labels(grid);
  Volume<float> scan(grid);
  std::uniform_int_distribution<int> label(0, kLabels);
  std::uniform_real_distribution<float> HU(-1000, 2500);
  for (LabelId& one : labels.voxels()) one = static_cast<LabelId>(label(random));
  for (float& one : scan.voxels()) one = HU(random);
  scan.at(3, 3, 3) = std::numeric_limits<float>::quiet_NaN();
  Model model;
  model.labels = std::make_shared<const Bricks<LabelId>>(labels, LabelId{0});
  model.scan = std::make_shared<const Volume<float>>(scan);
  model.full_density_HU = kDense_HU;
  model.tissues.resize(3);
  model.tissues[1].elastic = ElasticConstants{};
  model.tissues[2].touchable = false;
  model.tissue_of_label = {-1, 0, 1, 2};
  return model;
}

TEST(BoneDensity, VoxelsOfBoneFollowTheScanAndTheOthersDoNot) {
  std::mt19937 random(test::test_seed());
  const Model model = randomly_scanned(random);
  const auto ratios = density_ratios_of(model);
  ASSERT_NE(ratios, nullptr);
  const GridGeometry& grid = model.labels->geometry();
  const auto is_bone = [&](int i, int j, int k) {
    return grid.contains(i, j, k) && model.labels->at(i, j, k) == kRigid;
  };
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        double sum = 0, count = 0;
        for (int n = 0; n < 27; ++n) {
          const int a = i + n % 3 - 1, b = j + n / 3 % 3 - 1, c = k + n / 9 - 1;
          if (!is_bone(a, b, c)) continue;
          sum += density_ratio(model.scan->at(a, b, c), kDense_HU);
          ++count;
        }
        const double expected = is_bone(i, j, k) ? density_ratio(model.scan->at(i, j, k), kDense_HU)
                                : !model.is_touchable(model.labels->at(i, j, k)) && count > 0 ? sum / count
                                                                                              : 1;
        EXPECT_NEAR(density_ratio_at(ratios.get(), i, j, k), expected, 1.0 / kDensityRatioOne);
      }
  EXPECT_EQ(density_ratio_at(ratios.get(), -1, 0, 0), 1);
}

TEST(BoneDensity, WithoutACalibratedScanEnergiesAreThoseOfTheLabels) {
  std::mt19937 random(test::test_seed());
  Model model = randomly_scanned(random);
  model.full_density_HU = 0;
  EXPECT_EQ(density_ratios_of(model), nullptr);
  EXPECT_EQ(density_ratio_at(nullptr, 1, 1, 1), 1);
}

}  // namespace
}  // namespace palpate
