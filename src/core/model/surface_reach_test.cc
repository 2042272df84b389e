#include "model/surface_reach.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace palpate {
namespace {

using ::testing::HasSubstr;

namespace surface_reach {

GridGeometry grid_of(double slice_mm) {
  GridGeometry grid;
  grid.dims = {8, 8, 8};
  grid.spacing_mm = {0.8, 0.8, slice_mm};
  return grid;
}

Tool sphere(double radius_mm) {
  Tool tool;
  tool.radius_mm = radius_mm;
  return tool;
}

double reach_mm(const std::vector<Tool>& tools, double slice_mm) {
  const auto options = touchable_surface_options(tools, grid_of(slice_mm));
  EXPECT_TRUE(options.ok());
  return options.ok() ? options->reach_mm : 0;
}

}  // namespace surface_reach

TEST(SurfaceReach, SmallToolsOnFineVoxelsUseTheDefault) {
  for (const double radius_mm : {0.0, 1.5, 3.0})
    for (const double slice_mm : {0.3, 0.8, 1.0})
      EXPECT_EQ(surface_reach::reach_mm({surface_reach::sphere(radius_mm)}, slice_mm),
                SurfaceOptions().reach_mm);
}

TEST(SurfaceReach, GrowsWithToolRadiusAndSliceSpacing) {
  using surface_reach::reach_mm, surface_reach::sphere;
  EXPECT_EQ(reach_mm({sphere(3)}, 2.5), 7);
  EXPECT_EQ(reach_mm({sphere(0)}, 5), 9);
  EXPECT_EQ(reach_mm({sphere(12)}, 1), 13);
  EXPECT_EQ(reach_mm({sphere(0), sphere(6)}, 1), 7);
  Tool shaft = sphere(1);
  shaft.capsules.push_back({{0, 0, 0}, {0, 0, 100}, 8});
  EXPECT_EQ(reach_mm({shaft}, 1), 9);
  Tool burr = sphere(1);
  burr.burr.emplace().end_radius_mm = 4;
  EXPECT_EQ(reach_mm({burr}, 1), 5);
}

TEST(SurfaceReach, ThickSlicesAreClampedToTheMaximum) {
  EXPECT_EQ(surface_reach::reach_mm({surface_reach::sphere(3)}, 10), kMaxSurfaceReach_mm);
}

TEST(SurfaceReach, TooWideToolIsRejected) {
  const auto options = touchable_surface_options(std::vector<Tool>{Tool(), surface_reach::sphere(12)},
                                                 surface_reach::grid_of(5));
  ASSERT_FALSE(options.ok());
  EXPECT_EQ(options.error().kind, ErrorKind::kBadInput);
  EXPECT_EQ(options.error().what,
            "a tool of 12 mm radius is too wide for voxels of 5 mm: the sum exceeds 15 mm");
  EXPECT_THAT(options.error().remedy, HasSubstr("[second_tool]"));
}

}  // namespace
}  // namespace palpate
