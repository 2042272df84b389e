#include "surfaces/signed_distance.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "sampling/test_targets.h"

namespace palpate::internal {
namespace {

/// Distance to the nearest centre of the other class, by exhaustive search.
double oracle(const Block<std::uint8_t>& mask, const Eigen::Vector3d& spacing, double reach, int i, int j,
              int k) {
  const auto at = [&](int x, int y, int z) { return mask.row(y, z)[x - mask.span().low[0]]; };
  const std::uint8_t mine = at(i, j, k);
  double smallest = reach * reach;
  for_each_row(mask.span(), [&](int y, int z) {
    for (int x = mask.span().low[0]; x < mask.span().high[0]; ++x) {
      if (at(x, y, z) == mine) continue;
      const Eigen::Vector3d displacement((x - i) * spacing[0], (y - j) * spacing[1], (z - k) * spacing[2]);
      smallest = std::min(smallest, displacement.squaredNorm());
    }
  });
  return (mine != 0 ? -1 : 1) * std::sqrt(smallest);
}

Block<std::uint8_t> random_mask(const Span3& span, double fill, std::mt19937& random) {
  Block<std::uint8_t> mask(span);
  std::bernoulli_distribution set(fill);
  for (auto& m : mask.values()) m = set(random) ? 1 : 0;
  return mask;
}

TEST(SignedDistance, IsExactOnRandomMasksWithRandomSpacings) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> spacing_mm(0.25, 1.3), reach_mm(1, 5);
  for (const double fill : {0.0, 0.003, 0.03, 0.5, 0.98, 1.0}) {
    for (int round = 0; round < 3; ++round) {
      const Eigen::Vector3d spacing(spacing_mm(random), spacing_mm(random), spacing_mm(random));
      const double reach = reach_mm(random);
      const Span3 span{{-3, 2, 5}, {-3 + 19 - 4 * round, 2 + 7, 5 + 6}};
      const auto mask = random_mask(span.grown(distance_window(spacing, reach)), fill, random);
      Block<float> distance(span);
      signed_distance(mask, spacing, reach, distance);
      for_each_row(span, [&](int j, int k) {
        for (int i = span.low[0]; i < span.high[0]; ++i) {
          const double expected = oracle(mask, spacing, reach, i, j, k);
          EXPECT_NEAR(distance.row(j, k)[i - span.low[0]], expected, 2e-6 * std::abs(expected));
        }
      });
    }
  }
}

TEST(SignedDistance, IsBitIdenticalInPartsAndOnEveryTarget) {
  std::mt19937 random(3);
  const Eigen::Vector3d spacing(0.3, 0.5, 0.9);
  const double reach = 2.2;
  const Span3 span{{0, 0, 0}, {41, 12, 9}}, part{{7, 3, 4}, {30, 8, 6}};
  const Index3 window = distance_window(spacing, reach);
  const auto mask = random_mask(span.grown(window), 0.02, random);
  Block<float> all(span);
  signed_distance(mask, spacing, reach, all);

  Block<std::uint8_t> part_mask(part.grown(window));
  for_each_row(part_mask.span(), [&](int j, int k) {
    std::copy_n(mask.row(j, k) + (part_mask.span().low[0] - mask.span().low[0]), part_mask.span().size(0),
                part_mask.row(j, k));
  });
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    Block<float> some(part);
    signed_distance(part_mask, spacing, reach, some);
    for_each_row(part, [&](int j, int k) {
      for (int i = part.low[0]; i < part.high[0]; ++i) {
        EXPECT_EQ(some.row(j, k)[i - part.low[0]], all.row(j, k)[i]);
      }
    });
  }
}

}  // namespace
}  // namespace palpate::internal
