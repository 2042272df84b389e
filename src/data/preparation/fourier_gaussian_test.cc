#include "preparation/fourier_gaussian.h"

#include <gtest/gtest.h>

#include <numbers>

#include "base/test_seed.h"
#include "preparation/test_gaussian_volumes.h"

namespace palpate {
namespace {

using internal::binary_sphere;
using internal::random_binary;
using internal::test_grid;

constexpr double kAgreement = 0.05;  // in units of 1/255, before rounding, if sigma is at least 1.5 voxels

double difference(const Volume<std::uint8_t>& volume, double sigma_mm) {
  const auto result = compare_gaussian_engines(volume, sigma_mm);
  EXPECT_TRUE(result.ok());
  return result->max_abs;
}

TEST(FourierGaussian, AgreesWithTheDirectEngineFromOneAndAHalfVoxels) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const double sigma_voxels : {1.5, 1.6, 2.0, 2.75, 4.0, 7.3, 10.0}) {
    const GridGeometry grid = test_grid({53, 48, 41}, {1, 1, 1});
    EXPECT_LT(difference(random_binary(grid, random), sigma_voxels), kAgreement) << sigma_voxels;
    EXPECT_LT(difference(binary_sphere(grid, 15), sigma_voxels), kAgreement) << sigma_voxels;
    EXPECT_LT(difference(Volume<std::uint8_t>(grid, 255), sigma_voxels), kAgreement) << sigma_voxels;
  }
  // voxel size of the original publication
  const GridGeometry grid = test_grid({60, 50, 40}, {0.625, 0.625, 0.9});
  EXPECT_LT(difference(random_binary(grid, random), 1.5), kAgreement);
  EXPECT_LT(difference(binary_sphere(grid, 12), 1.5), kAgreement);
}

TEST(FourierGaussian, AgreesOnTheWorstBinaryVolumeForTheTwoKernels) {
  // worst case: full exactly where the impulse response of one engine exceeds the other's
  for (const double sigma : {1.5, 1.75, 2.0, 2.5}) {
    const int reach = static_cast<int>(std::ceil(6 * sigma)), n = 2 * reach + 1;
    Volume<float> impulse(test_grid({n, n, n}, {1, 1, 1}));
    impulse.at(reach, reach, reach) = 255;
    const auto direct = gaussian_smooth(impulse, {.sigma_mm = sigma});
    const auto fourier = gaussian_smooth(impulse, {.sigma_mm = sigma, .engine = GaussianEngine::kFourier});
    double excess = 0, deficit = 0;
    for (std::size_t m = 0; m < impulse.voxels().size(); ++m) {
      const double d = static_cast<double>(direct->voxels()[m]) - fourier->voxels()[m];
      (d > 0 ? excess : deficit) += std::abs(d);
    }
    EXPECT_LT(std::max(excess, deficit), kAgreement) << sigma;
  }
}

TEST(FourierGaussian, PartsFromTheDirectEngineWhereSigmaIsPoorlySampled) {
  const auto sphere = binary_sphere(test_grid({40, 40, 40}, {1, 1, 1}), 12);
  const double at_half = difference(sphere, 0.5), at_three_quarters = difference(sphere, 0.75),
               at_one = difference(sphere, 1);
  EXPECT_GT(at_half, 5);
  EXPECT_GT(at_three_quarters, 0.5);
  EXPECT_LT(at_three_quarters, at_half);
  EXPECT_LT(at_one, at_three_quarters);
}

TEST(FourierGaussian, ReportsHowFineSigmaIsSampled) {
  const auto sphere = binary_sphere(test_grid({12, 12, 12}, {0.5, 1, 2}), 3);
  const auto result = compare_gaussian_engines(sphere, 1);
  ASSERT_TRUE(result.ok());
  EXPECT_EQ(result->sigma_voxels, (std::array{2.0, 1.0, 0.5}));
  EXPECT_GT(result->mean_abs, 0);
  EXPECT_LT(result->mean_abs, result->max_abs);
}

TEST(FourierGaussian, WrapsNothingRoundAnyAxis) {
  for (int axis = 0; axis < 3; ++axis) {
    const GridGeometry grid = test_grid({32, 30, 27}, {1, 1, 1});
    Volume<std::uint8_t> volume(grid);
    for (int k = 0; k < grid.dims[2]; ++k) {
      for (int j = 0; j < grid.dims[1]; ++j) {
        for (int i = 0; i < grid.dims[0]; ++i) volume.at(i, j, k) = std::array{i, j, k}[axis] == 0 ? 255 : 0;
      }
    }
    const auto smooth = gaussian_smooth_16(volume, {.sigma_mm = 3, .engine = GaussianEngine::kFourier});
    std::array far{15, 15, 13};
    far[axis] = grid.dims[axis] - 1;
    EXPECT_LE(smooth->at(far[0], far[1], far[2]), 1);
    far[axis] = 1;
    EXPECT_GT(smooth->at(far[0], far[1], far[2]), 1000);
  }
}

TEST(FourierGaussian, SmoothsVolumesOfAnySizeAndSign) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const auto& dims : {std::array{1, 1, 1}, std::array{2, 1, 5}, std::array{1, 17, 1},
                           std::array{31, 2, 3}, std::array{9, 10, 11}}) {
    const auto volume = internal::random_floats(test_grid(dims, {1, 1, 1}), random);
    const auto direct = gaussian_smooth(volume, {.sigma_mm = 2});
    const auto fourier = gaussian_smooth(volume, {.sigma_mm = 2, .engine = GaussianEngine::kFourier});
    ASSERT_TRUE(direct.ok() && fourier.ok());
    for (std::size_t n = 0; n < volume.voxels().size(); ++n) {
      ASSERT_NEAR(direct->voxels()[n], fourier->voxels()[n], 1000 * 2 * kAgreement / 255);
    }
  }
}

TEST(FourierGaussian, RoundsBytesAndWordsToNearest) {
  std::mt19937 random(21);
  const auto bytes = internal::random_bytes(test_grid({20, 19, 18}, {1, 1, 1}), random);
  const Volume<float> floats(bytes.geometry(),
                             std::vector<float>(bytes.voxels().begin(), bytes.voxels().end()));
  const GaussianOptions options{.sigma_mm = 1.5, .engine = GaussianEngine::kFourier};
  const auto exact = gaussian_smooth(floats, options);
  const auto rounded = gaussian_smooth(bytes, options);
  const auto rounded_16 = gaussian_smooth_16(bytes, options);
  for (std::size_t n = 0; n < bytes.voxels().size(); ++n) {
    ASSERT_LE(std::abs(rounded->voxels()[n] - exact->voxels()[n]), 0.5);
    ASSERT_LE(std::abs(rounded_16->voxels()[n] - 257 * exact->voxels()[n]), 0.51);
  }
}

TEST(FourierGaussian, HasThePublishedResponse) {
  const auto response = internal::gaussian_response(1.5, 10);
  EXPECT_EQ(response[0], 1);
  const double nu = 0.3;
  EXPECT_NEAR(response[3], std::exp(-2 * std::pow(std::numbers::pi * 1.5 * nu, 2)), 1e-7);
  for (int m = 1; m < 10; ++m) EXPECT_EQ(response[m], response[10 - m]) << m;
}

}  // namespace
}  // namespace palpate
