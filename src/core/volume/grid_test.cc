#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <new>
#include <string>

#include "palpate/volume/grid.h"

namespace palpate {
namespace {

const double kNaN = std::numeric_limits<double>::quiet_NaN();

std::string fault_of(const std::function<void(GridGeometry&)>& change) {
  GridGeometry grid;
  grid.dims = {4, 5, 6};
  change(grid);
  const auto checked = check_grid(grid);
  if (checked.ok()) return "none";
  EXPECT_EQ(checked.error().kind, ErrorKind::kBadInput);
  EXPECT_FALSE(checked.error().what.empty());
  EXPECT_FALSE(checked.error().remedy.empty());
  return checked.error().where;
}

TEST(Grid, ValidGridIsAccepted) {
  EXPECT_EQ(fault_of([](GridGeometry&) {}), "none");
  EXPECT_EQ(fault_of([](GridGeometry& grid) { grid.direction.col(2) *= -1; }), "none") << "left-handed";
  EXPECT_EQ(fault_of([](GridGeometry& grid) { grid.spacing_mm = {0.1, 0.6, 3}; }), "none");
}

TEST(Grid, InvalidMemberIsNamed) {
  for (const int dim : {0, -1, std::numeric_limits<int>::min(), std::numeric_limits<int>::max()})
    EXPECT_EQ(fault_of([&](GridGeometry& grid) { grid.dims[1] = dim; }), "dims") << dim;
  for (const double spacing_mm : {0.0, -1.0, 1e-9, 1e9, kNaN, HUGE_VAL})
    EXPECT_EQ(fault_of([&](GridGeometry& grid) { grid.spacing_mm[2] = spacing_mm; }), "spacing_mm")
        << spacing_mm;
  for (const double x : {0.0, 2.0, kNaN, HUGE_VAL})
    EXPECT_EQ(fault_of([&](GridGeometry& grid) { grid.direction(0, 0) = x; }), "direction") << x;
  EXPECT_EQ(fault_of([](GridGeometry& grid) { grid.direction.col(1) = grid.direction.col(0); }), "direction");
  for (const double x : {-1e7, kNaN, HUGE_VAL})
    EXPECT_EQ(fault_of([&](GridGeometry& grid) { grid.origin[0] = x; }), "origin") << x;
}

TEST(Grid, OversizedVolumeThrowsOnlyBadAlloc) {
  constexpr int kMax = std::numeric_limits<int>::max();
  GridGeometry grid;
  for (const std::array<int, 3>& dims :
       {std::array{-1, 1, 1}, std::array{-1, -1, 1}, std::array{kMax, kMax, kMax}, std::array{0, -1, 5}}) {
    grid.dims = dims;
    EXPECT_THROW(Volume<LabelId> volume(grid), std::bad_alloc);
  }
}

}  // namespace
}  // namespace palpate
