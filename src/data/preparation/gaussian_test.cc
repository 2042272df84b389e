#include <gtest/gtest.h>

#include <atomic>
#include <limits>
#include <mutex>
#include <numbers>

#include "base/test_seed.h"
#include "preparation/test_gaussian_volumes.h"

namespace palpate {
namespace {

using internal::binary_sphere;
using internal::random_bytes;
using internal::random_floats;
using internal::test_grid;

// ---- reference: one sum over the whole box of the kernel, in double ------------------------------

std::vector<double> oracle_weights(double sigma_mm, double spacing_mm) {
  const int radius = static_cast<int>(std::ceil(4 * sigma_mm / spacing_mm));
  std::vector<double> weights;
  double sum = 0;
  for (int t = -radius; t <= radius; ++t) {
    weights.push_back(std::exp(-std::pow(t * spacing_mm / sigma_mm, 2) / 2));
    sum += weights.back();
  }
  for (double& w : weights) w /= sum;
  return weights;
}

template <class T>
Volume<double> oracle_smooth(const Volume<T>& volume, double sigma_mm) {
  const GridGeometry& grid = volume.geometry();
  std::array<std::vector<double>, 3> w;
  std::array<int, 3> r;
  for (int axis = 0; axis < 3; ++axis) {
    w[axis] = oracle_weights(sigma_mm, grid.spacing_mm[axis]);
    r[axis] = static_cast<int>(w[axis].size() / 2);
  }
  Volume<double> smooth(grid);
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        double sum = 0;
        for (int c = -r[2]; c <= r[2]; ++c) {
          for (int b = -r[1]; b <= r[1]; ++b) {
            for (int a = -r[0]; a <= r[0]; ++a) {
              if (!grid.contains(i + a, j + b, k + c)) continue;
              sum += w[0][a + r[0]] * w[1][b + r[1]] * w[2][c + r[2]] * volume.at(i + a, j + b, k + c);
            }
          }
        }
        smooth.at(i, j, k) = sum;
      }
    }
  }
  return smooth;
}

double max_difference(const Volume<float>& a, const Volume<double>& b) {
  double worst = 0;
  for (std::size_t n = 0; n < a.voxels().size(); ++n) {
    worst = std::max(worst, std::abs(a.voxels()[n] - b.voxels()[n]));
  }
  return worst;
}

// rows shorter and longer than any vector, single voxels along any axis, kernels wider than the grid
const std::array<std::array<int, 3>, 12> kSizes{{{1, 1, 1},
                                                 {2, 3, 1},
                                                 {1, 9, 1},
                                                 {1, 1, 12},
                                                 {15, 2, 2},
                                                 {16, 3, 2},
                                                 {17, 13, 11},
                                                 {3, 3, 3},
                                                 {64, 2, 3},
                                                 {65, 4, 1},
                                                 {83, 1, 5},
                                                 {130, 3, 2}}};

TEST(GaussianSmooth, EqualsTheTripleSumOnRandomVolumesOfAnySize) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const auto& dims : kSizes) {
    for (const double sigma_mm : {0.4, 1.1, 1.8}) {
      SCOPED_TRACE(testing::Message()
                   << dims[0] << "x" << dims[1] << "x" << dims[2] << ", sigma " << sigma_mm);
      const GridGeometry grid = test_grid(dims, {0.7, 1.0, 1.3});
      const GaussianOptions options{.sigma_mm = sigma_mm, .threads = 2};

      const auto bytes = random_bytes(grid, random);
      const auto expected = oracle_smooth(bytes, sigma_mm);
      const auto smooth = gaussian_smooth(bytes, options);
      const auto smooth_16 = gaussian_smooth_16(bytes, options);
      ASSERT_TRUE(smooth.ok() && smooth_16.ok());
      for (std::size_t n = 0; n < bytes.voxels().size(); ++n) {
        ASSERT_LE(std::abs(smooth->voxels()[n] - expected.voxels()[n]), 0.5 + 2e-4);
        ASSERT_LE(std::abs(smooth_16->voxels()[n] - 257 * expected.voxels()[n]), 0.5 + 5e-2);
      }

      const auto floats = random_floats(grid, random);
      const auto smooth_floats = gaussian_smooth(floats, options);
      ASSERT_TRUE(smooth_floats.ok());
      EXPECT_LT(max_difference(*smooth_floats, oracle_smooth(floats, sigma_mm)), 1e-3);
    }
  }
}

TEST(GaussianSmooth, DoesNotDependOnTheNumberOfThreads) {
  std::mt19937 random(11);
  const auto volume = random_bytes(test_grid({37, 21, 29}, {0.6, 0.6, 0.9}), random);
  for (const auto engine : {GaussianEngine::kDirect, GaussianEngine::kFourier}) {
    const auto one = gaussian_smooth_16(volume, {.sigma_mm = 1.5, .engine = engine, .threads = 1});
    ASSERT_TRUE(one.ok());
    for (const int threads : {0, 2, 3, 16, 64}) {
      const auto many = gaussian_smooth_16(volume, {.sigma_mm = 1.5, .engine = engine, .threads = threads});
      ASSERT_TRUE(many.ok());
      EXPECT_EQ(one->voxels(), many->voxels()) << threads;
    }
  }
}

TEST(GaussianSmooth, OfNoWidthLeavesTheValuesAsTheyAre) {
  std::mt19937 random(12);
  const GridGeometry grid = test_grid({19, 4, 3}, {1, 1, 1});
  const auto bytes = random_bytes(grid, random);
  const auto floats = random_floats(grid, random);
  for (const auto engine : {GaussianEngine::kDirect, GaussianEngine::kFourier}) {
    const GaussianOptions options{.sigma_mm = 0, .engine = engine};
    EXPECT_EQ(gaussian_smooth(bytes, options)->voxels(), bytes.voxels());
    EXPECT_EQ(gaussian_smooth(floats, options)->voxels(), floats.voxels());
    const auto words = gaussian_smooth_16(bytes, options);
    for (std::size_t n = 0; n < bytes.voxels().size(); ++n) {
      ASSERT_EQ(words->voxels()[n], 257 * bytes.voxels()[n]);
    }
  }
}

// ---- physics -------------------------------------------------------------------------------------

TEST(GaussianSmooth, TurnsAnImpulseIntoTheGaussianInMillimetres) {
  const double sigma_mm = 1.6;
  const GridGeometry grid = test_grid({41, 31, 25}, {0.4, 0.7, 1.1});
  Volume<float> volume(grid);
  volume.at(20, 15, 12) = 1000;
  const auto smooth = gaussian_smooth(volume, {.sigma_mm = sigma_mm});
  ASSERT_TRUE(smooth.ok());
  const double peak =
      1000 * grid.voxel_volume_mm3() / std::pow(2 * std::numbers::pi * sigma_mm * sigma_mm, 1.5);
  for (int k = 0; k < 25; ++k) {
    for (int j = 0; j < 31; ++j) {
      for (int i = 0; i < 41; ++i) {
        const Eigen::Vector3d d = grid.spacing_mm.cwiseProduct(Eigen::Vector3d(i - 20, j - 15, k - 12));
        const double expected = peak * std::exp(-d.squaredNorm() / (2 * sigma_mm * sigma_mm));
        // truncation at 4 sigma removes 3.4e-4 of the peak and raises the rest by 2e-4
        ASSERT_NEAR(smooth->at(i, j, k), expected, 4e-4 * peak);
      }
    }
  }
}

TEST(GaussianSmooth, KeepsTheSumFarFromTheBorder) {
  std::mt19937 random(13);
  Volume<float> volume(test_grid({40, 40, 40}, {0.8, 0.8, 0.8}));
  std::uniform_real_distribution<float> level(0, 255);
  double sum = 0;
  for (int k = 15; k < 25; ++k) {
    for (int j = 15; j < 25; ++j) {
      for (int i = 15; i < 25; ++i) sum += volume.at(i, j, k) = level(random);
    }
  }
  const auto smooth = gaussian_smooth(volume, {.sigma_mm = 2.5});
  double smooth_sum = 0;
  for (const float v : smooth->voxels()) smooth_sum += v;
  EXPECT_NEAR(smooth_sum, sum, 1e-5 * sum);
}

TEST(GaussianSmooth, KeepsConstantsAndSlopesFarFromTheBorder) {
  const GridGeometry grid = test_grid({30, 30, 30}, {1, 1, 1});
  Volume<float> slope(grid);
  for (int k = 0; k < 30; ++k) {
    for (int j = 0; j < 30; ++j) {
      for (int i = 0; i < 30; ++i) slope.at(i, j, k) = static_cast<float>(7 + 3 * i - 2 * j + k);
    }
  }
  const GaussianOptions options{.sigma_mm = 2};
  const auto smooth = gaussian_smooth(slope, options);
  const auto constant = gaussian_smooth(Volume<std::uint8_t>(grid, 200), options);
  for (int n = 8; n < 22; ++n) {
    EXPECT_NEAR(smooth->at(n, 12, 20), slope.at(n, 12, 20), 1e-4);
    EXPECT_EQ(constant->at(n, 12, 20), 200);
  }
}

TEST(GaussianSmooth, AddsVariancesWhenAppliedTwice) {
  const auto volume = [] {
    const auto sphere = binary_sphere(test_grid({40, 40, 40}, {1, 1, 1}), 8);
    return Volume<float>(sphere.geometry(),
                         std::vector<float>(sphere.voxels().begin(), sphere.voxels().end()));
  }();
  const auto first = gaussian_smooth(volume, {.sigma_mm = 1.5});
  const auto twice = gaussian_smooth(*first, {.sigma_mm = 2});
  const auto once = gaussian_smooth(volume, {.sigma_mm = 2.5});
  double worst = 0;
  for (std::size_t n = 0; n < once->voxels().size(); ++n) {
    worst = std::max<double>(worst, std::abs(once->voxels()[n] - twice->voxels()[n]));
  }
  EXPECT_LT(worst, 0.05) << "of 255";
}

TEST(GaussianSmooth, CommutesWithMirroringBitForBit) {
  std::mt19937 random(14);
  const GridGeometry grid = test_grid({23, 18, 14}, {0.5, 0.8, 1.2});
  const auto volume = random_floats(grid, random);
  const auto smooth = gaussian_smooth(volume, {.sigma_mm = 1.3});
  for (int axis = 0; axis < 3; ++axis) {
    const auto mirror = [&](const Volume<float>& from) {
      Volume<float> to(grid);
      for (int k = 0; k < grid.dims[2]; ++k) {
        for (int j = 0; j < grid.dims[1]; ++j) {
          for (int i = 0; i < grid.dims[0]; ++i) {
            std::array at{i, j, k};
            at[axis] = grid.dims[axis] - 1 - at[axis];
            to.at(at[0], at[1], at[2]) = from.at(i, j, k);
          }
        }
      }
      return to;
    };
    EXPECT_EQ(gaussian_smooth(mirror(volume), {.sigma_mm = 1.3})->voxels(), mirror(*smooth).voxels()) << axis;
  }
}

TEST(GaussianSmooth, TurnsAHalfSpaceIntoTheErrorFunctionWithTheKnownSlope) {
  // full for i < 30: the surface is between two voxel centres
  const double sigma_mm = 1.5;
  for (const double spacing : {0.5, 0.75, 1.0}) {
    Volume<std::uint8_t> volume(test_grid({60, 30, 30}, {spacing, spacing, spacing}));
    for (int k = 0; k < 30; ++k) {
      for (int j = 0; j < 30; ++j) {
        for (int i = 0; i < 30; ++i) volume.at(i, j, k) = 255;
      }
    }
    const auto smooth = gaussian_smooth_16(volume, {.sigma_mm = sigma_mm});
    const auto value = [&](int i) { return smooth->at(i, 15, 15) / 65535.0; };
    // a sum of samples equals the integral up to h^2 / 24 |g'| + 7 h^4 / 5760 |g'''|, both at their maxima
    const double h = spacing / sigma_mm;
    const double tolerance = h * h / 24 * 0.242 + 7 * h * h * h * h / 5760 * 0.551 + 1e-4;
    for (int i = 14; i < 46; ++i) {
      const double depth_mm = (29.5 - i) * spacing;
      EXPECT_NEAR(value(i), 0.5 * std::erfc(-depth_mm / (sigma_mm * std::numbers::sqrt2)), tolerance) << i;
    }
    // truncation at 4 sigma raises the weights by 6e-5; rounding to 16 bits adds at most 1.5e-5
    const double slope = 1 / (sigma_mm * std::sqrt(2 * std::numbers::pi));
    EXPECT_NEAR((value(29) - value(30)) / spacing, slope, 1e-4 * slope + 2e-5 / spacing);
  }
}

// ---- progress, interruption, errors --------------------------------------------------------------

TEST(GaussianSmooth, ReportsProgressForwardToTheEnd) {
  std::mt19937 random(15);
  const auto volume = random_bytes(test_grid({30, 30, 30}, {1, 1, 1}), random);
  for (const auto engine : {GaussianEngine::kDirect, GaussianEngine::kFourier}) {
    std::vector<double> fractions;
    const Progress progress([&](std::string_view, double fraction) { fractions.push_back(fraction); },
                            nullptr);
    ASSERT_TRUE(gaussian_smooth(volume, {.sigma_mm = 1.5, .engine = engine, .threads = 3}, progress).ok());
    ASSERT_GE(fractions.size(), 2u);
    EXPECT_TRUE(std::is_sorted(fractions.begin(), fractions.end()));
    EXPECT_GE(fractions.front(), 0);
    EXPECT_EQ(fractions.back(), 1);
  }
}

TEST(GaussianSmooth, StopsWhenAsked) {
  std::mt19937 random(16);
  const auto volume = random_bytes(test_grid({40, 40, 40}, {1, 1, 1}), random);
  for (const auto engine : {GaussianEngine::kDirect, GaussianEngine::kFourier}) {
    for (const double when : {0.0, 0.5, 0.8}) {
      std::atomic<bool> stop{when == 0};
      const Progress progress([&](std::string_view, double fraction) { stop = stop || fraction >= when; },
                              &stop);
      const auto smooth =
          gaussian_smooth(volume, {.sigma_mm = 1.5, .engine = engine, .threads = 2}, progress);
      ASSERT_FALSE(smooth.ok()) << when;
      EXPECT_EQ(smooth.error().kind, ErrorKind::kInterrupted);
    }
  }
  const std::atomic<bool> stop{true};
  const auto difference = compare_gaussian_engines(volume, 1.5, Progress({}, &stop));
  ASSERT_FALSE(difference.ok());
  EXPECT_EQ(difference.error().kind, ErrorKind::kInterrupted);
}

TEST(GaussianSmooth, RejectsInvalidInput) {
  Volume<float> volume(test_grid({3, 3, 3}, {1, 1, 1}));
  EXPECT_EQ(gaussian_smooth(volume, {.sigma_mm = -1}).error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(gaussian_smooth(volume, {.sigma_mm = 1, .threads = -1}).error().kind, ErrorKind::kBadInput);
  EXPECT_FALSE(compare_gaussian_engines(Volume<std::uint8_t>(volume.geometry()), 11).ok());
  for (const float bad : {std::numeric_limits<float>::quiet_NaN(), std::numeric_limits<float>::infinity()}) {
    volume.at(1, 1, 1) = bad;
    EXPECT_EQ(gaussian_smooth(volume, {.sigma_mm = 1}).error().kind, ErrorKind::kBadInput);
  }
}

TEST(GaussianSmooth, ZeroVolumeStaysZero) {
  for (const auto engine : {GaussianEngine::kDirect, GaussianEngine::kFourier}) {
    const auto smooth = gaussian_smooth(Volume<std::uint8_t>(), {.sigma_mm = 1, .engine = engine});
    ASSERT_TRUE(smooth.ok());
    EXPECT_TRUE(smooth->empty());
  }
}

}  // namespace
}  // namespace palpate
