#include <gtest/gtest.h>

#include <algorithm>
#include <limits>

#include "palpate/preparation/preparation.h"

namespace palpate {
namespace {

Volume<float> row(std::vector<float> values) {
  GridGeometry grid;
  grid.dims = {static_cast<int>(values.size()), 1, 1};
  return Volume<float>(grid, std::move(values));
}

TEST(RampScan, RisesLinearlyBetweenItsEnds) {
  const auto ramp = ramp_scan(row({-1000, 200, 201, 250, 300, 400, 500, 3000}), 200, 400);
  EXPECT_EQ(ramp.voxels(), (std::vector<std::uint8_t>{0, 0, 1, 64, 128, 255, 255, 255}));
}

TEST(RampScan, EndsAtItsWeight) {
  EXPECT_EQ(ramp_scan(row({0, 50, 100}), 0, 100, 0.4).voxels(), (std::vector<std::uint8_t>{0, 51, 102}));
  EXPECT_EQ(ramp_scan(row({0, 50, 100}), 0, 100, 0).voxels(), (std::vector<std::uint8_t>{0, 0, 0}));
}

TEST(RampScan, FindsFreeSpaceWhereThereIsNoNumber) {
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  EXPECT_EQ(ramp_scan(row({nan, inf, -inf}), 0, 1).voxels(), (std::vector<std::uint8_t>{0, 255, 0}));
}

TEST(RampScan, NeverFallsAsTheScanRises) {
  std::vector<float> values(2000);
  for (std::size_t n = 0; n < values.size(); ++n) values[n] = static_cast<float>(n) * 0.173f - 50;
  const auto ramp = ramp_scan(row(values), 3, 250);
  EXPECT_TRUE(std::is_sorted(ramp.voxels().begin(), ramp.voxels().end()));
  EXPECT_EQ(ramp.voxels().front(), 0);
  EXPECT_EQ(ramp.voxels().back(), 255);
}

}  // namespace
}  // namespace palpate
