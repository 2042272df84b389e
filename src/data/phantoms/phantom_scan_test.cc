#include "phantoms/phantom_scan.h"

#include <gtest/gtest.h>

#include <cmath>

namespace palpate {
namespace {

using enum PhantomMaterial;
using enum PhantomImaging;

constexpr double kVoxel_mm = 0.6;

TEST(KneePhantomScan, FarOutsideNothingChangesAndDeepInsideOnlyThePartIsSeen) {
  for (const auto material : {kFat, kMuscle, kFluid, kBone, kCartilage, kMeniscus, kLigament, kVessel}) {
    EXPECT_EQ(paint(material, kProtonDensity, 123, 5, kVoxel_mm), 123);
    EXPECT_EQ(paint(material, kProtonDensity, 123, -5, kVoxel_mm),
              paint(material, kProtonDensity, 800, -5, kVoxel_mm));
  }
}

TEST(KneePhantomScan, ASurfaceThroughTheCentreMixesHalfAndHalf) {
  const double deep = paint(kCartilage, kProtonDensity, 0, -5, kVoxel_mm);
  EXPECT_DOUBLE_EQ(paint(kCartilage, kProtonDensity, 100, 0, kVoxel_mm), 0.5 * (100 + deep));
  EXPECT_DOUBLE_EQ(paint(kCartilage, kProtonDensity, 100, -0.15, kVoxel_mm), 0.25 * 100 + 0.75 * deep);
}

TEST(KneePhantomScan, BoneIsBrightInsideADarkRim) {
  const double marrow = paint(kBone, kProtonDensity, 700, -5, kVoxel_mm);
  const double rim = paint(kBone, kProtonDensity, 700, -0.5 * material_depth_mm(kBone), kVoxel_mm);
  EXPECT_LT(rim, 0.2 * marrow);
}

TEST(KneePhantomScan, TissuesStandInTheOrderOfAProtonDensityScan) {
  const auto deep = [](PhantomMaterial material) {
    return paint(material, kProtonDensity, 0, -5, kVoxel_mm);
  };
  EXPECT_GT(deep(kFluid), deep(kFat));
  EXPECT_GT(deep(kFat), deep(kBone));
  EXPECT_GT(deep(kBone), deep(kCartilage));
  EXPECT_GT(deep(kCartilage), deep(kMuscle));
  EXPECT_GT(deep(kMuscle), 2 * deep(kLigament));
  EXPECT_GT(deep(kMuscle), 2 * deep(kMeniscus));
}

TEST(KneePhantomScan, ShadingStaysMild) {
  for (const double x : {-55.0, 0.0, 55.0}) {
    for (const double y : {-59.0, 0.0, 51.0}) {
      for (const double z : {-60.0, 0.0, 60.0}) EXPECT_NEAR(shading(kProtonDensity, {x, y, z}), 1, 0.18);
    }
  }
}

// Rician: the second moment is A^2 + 2 sigma^2 and, without a signal, the mean sigma sqrt(pi / 2).
TEST(KneePhantomScan, NoiseHasTheMomentsOfAMagnitudeImage) {
  constexpr std::size_t n = 200'000;
  const double sigma = 10;
  for (const float signal : {0.0f, 15.0f, 500.0f}) {
    std::vector<float> voxels(n, signal);
    add_rician_noise(voxels.data(), n, sigma, 5, 0);
    double mean = 0, square = 0;
    for (const float v : voxels) {
      mean += v / double{n};
      square += double{v} * v / double{n};
    }
    const double expected = signal * signal + 2 * sigma * sigma;
    EXPECT_NEAR(square / expected, 1, 0.015) << signal;
    if (signal == 0) {
      EXPECT_NEAR(mean, sigma * std::sqrt(std::acos(-1.0) / 2), 0.1);
    }
    if (signal == 500) {
      EXPECT_NEAR(std::sqrt(square - mean * mean), sigma, 0.15);
    }
  }
}

TEST(KneePhantomScan, NoiseDependsOnSeedAndSliceAlone) {
  const auto noise = [](std::uint64_t seed, int slice) {
    std::vector<float> voxels(100, 50.0f);
    add_rician_noise(voxels.data(), voxels.size(), 10, seed, slice);
    return voxels;
  };
  EXPECT_EQ(noise(1, 3), noise(1, 3));
  EXPECT_NE(noise(1, 3), noise(1, 4));
  EXPECT_NE(noise(1, 3), noise(2, 3));
  EXPECT_NE(noise(1, 3), noise(3, 1));
}

}  // namespace
}  // namespace palpate
