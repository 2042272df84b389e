#include "palpate/volume/gaussian_kernel.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace palpate::internal {
namespace {

TEST(GaussianKernel, ReachesFourSigmaAndSumsToOne) {
  for (const double sigma : {0.3, 0.75, 1.5, 2.0, 5.37, 33.0}) {
    const AxisKernel kernel = sample_gaussian(sigma, 1000);
    EXPECT_EQ(kernel.radius(), static_cast<int>(std::ceil(4 * sigma)));
    double sum = kernel.weights[0];
    for (int t = 1; t <= kernel.radius(); ++t) sum += 2.0 * kernel.weights[t];
    EXPECT_NEAR(sum, 1, 1e-6) << sigma;
  }
}

TEST(GaussianKernel, HasTheRequestedVariance) {
  for (const double sigma : {1.0, 1.5, 4.0}) {
    const AxisKernel kernel = sample_gaussian(sigma, 1000);
    double variance = 0;
    for (int t = 1; t <= kernel.radius(); ++t) variance += 2.0 * kernel.weights[t] * t * t;
    EXPECT_NEAR(variance, sigma * sigma, 1.1e-3 * sigma * sigma) << sigma;
    EXPECT_GT(std::abs(variance - (sigma * sigma + 1.0 / 12)), 5e-3 * sigma * sigma) << sigma;
  }
}

TEST(GaussianKernel, OmitsOnlyWeightsBeyondTheVolume) {
  const AxisKernel whole = sample_gaussian(3, 1000), cut = sample_gaussian(3, 4);
  ASSERT_EQ(cut.radius(), 4);
  for (int t = 0; t <= 4; ++t) EXPECT_EQ(cut.weights[t], whole.weights[t]);
}

TEST(GaussianKernel, ZeroWidthIsTheIdentity) {
  EXPECT_EQ(sample_gaussian(0, 10).weights, std::vector<float>{1.0f});
}

TEST(GaussianKernel, RejectsInvalidSigmas) {
  GridGeometry grid;
  grid.dims = {4, 4, 4};
  grid.spacing_mm = {0.5, 1, 2};
  const auto sigma = sigma_in_voxels(grid, 1.5);
  ASSERT_TRUE(sigma.ok());
  EXPECT_EQ(*sigma, (std::array{3.0, 1.5, 0.75}));
  for (const double bad :
       {-0.1, 10.01, std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
    ASSERT_FALSE(sigma_in_voxels(grid, bad).ok()) << bad;
    EXPECT_EQ(sigma_in_voxels(grid, bad).error().kind, ErrorKind::kBadInput);
  }
  grid.spacing_mm[1] = 1e-6;
  ASSERT_FALSE(sigma_in_voxels(grid, 1).ok());
  EXPECT_NE(sigma_in_voxels(grid, 1).error().what.find("axis j"), std::string::npos);
}

}  // namespace
}  // namespace palpate::internal
