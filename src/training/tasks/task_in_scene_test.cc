#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "palpate/tasks/task.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

/// A slab of 20 x 10 x 2 mm of structure 1 and a block of 4 x 4 x 4 mm of structure 2 above its left end, in
/// voxels of 0.5 mm.
Model slab() {
  GridGeometry grid;
  grid.dims = {60, 40, 30};
  grid.spacing_mm = {0.5, 0.5, 0.5};
  grid.origin = Point<Patient>(-4.75, -4.75, -4.75);
  Volume<LabelId> labels(grid, 0);
  for (int k = 0; k < 30; ++k) {
    for (int j = 0; j < 40; ++j) {
      for (int i = 0; i < 60; ++i) {
        const Eigen::Vector3d at = grid.origin.eigen() + 0.5 * Eigen::Vector3d(i, j, k);
        if (at[0] > 0 && at[0] < 20 && at[1] > 0 && at[1] < 10 && at[2] > 0 && at[2] < 2)
          labels.at(i, j, k) = 1;
        if (at[0] > 0 && at[0] < 4 && at[1] > 0 && at[1] < 4 && at[2] > 3 && at[2] < 7)
          labels.at(i, j, k) = 2;
      }
    }
  }
  Model model;
  model.labels = label_bricks(labels);
  model.segments = {{1, "slab", {}, 0, 1}, {2, "block", {}, 0, 2}};
  return model;
}

Result<TaskInScene> with_region(const std::string& region) {
  const auto task = parse_task(
      "title = \"Cover\"\n[[region]]\nname = \"r\"\n" + region +
          "\n[[step]]\nname = \"s\"\nregion = \"r\"\nkind = \"cover\"\n[[metric]]\nname = \"coverage\"\n",
      "task.toml");
  EXPECT_TRUE(task.ok()) << task.error().message();
  return resolve_task(*task, slab());
}

TEST(LookUp, APatchIsASquareMillimetreOfSurface) {
  // faces on cube boundaries may be assigned to either side: the top, with faces at z = 2 assigned to the
  // cubes above, has 20 x 10
  const auto found =
      with_region("structures = [\"slab\"]\nplane_point = [0, 0, 1.6]\nplane_normal = \"superior\"");
  ASSERT_TRUE(found.ok());
  SurfacePatches top = found->regions[0].patches;
  // the rim's faces from 1.6 to 2 are separate cubes below it or next to it
  EXPECT_GE(top.count(), 200u);
  EXPECT_LE(top.count(), 200u + 2 * 60 + 8);
}

TEST(LookUp, PlacesBoundRegions) {
  const auto left = with_region("structures = [\"slab\"]\nhalf = \"left\"");
  EXPECT_TRUE(left->regions[0].contains_point({15, 5, 1}));
  EXPECT_FALSE(left->regions[0].contains_point({5, 5, 1}));
  const auto end = with_region("structures = [1]\nlandmark = \"left\"\nradius = 4");
  EXPECT_NEAR((*end->regions[0].centre_mm - Eigen::Vector3d(19.75, 5, 1)).norm(), 0, 1e-9);
  EXPECT_LT(end->regions[0].patches.count(), left->regions[0].patches.count());
  const auto both = with_region("structures = [\"slab\", \"block\"]");
  EXPECT_GT(both->regions[0].patches.count(), left->regions[0].patches.count());
  EXPECT_TRUE(both->regions[0].has(2));
  EXPECT_FALSE(left->regions[0].has(2));
}

TEST(LookUp, ReportsMissingStructures) {
  EXPECT_THAT(with_region("structures = [\"slap\"]").error().message(),
              ::testing::AllOf(HasSubstr("task.toml:2"), HasSubstr("no structure \"slap\""),
                               HasSubstr("slab, block")));
  EXPECT_THAT(with_region("structures = [9]").error().what, HasSubstr("no label 9"));
  EXPECT_THAT(with_region("structures = [1]\npoint = [500, 0, 0]\nradius = 3").error().what,
              HasSubstr("none of its structures"));
}

TEST(RegionView, LooksWhereTheRegionIsFree) {
  Model model = slab();
  model.tissues = {Tissue{}};
  model.tissue_of_label = {-1, 0, 0};
  const auto view = [&](const std::string& region) {
    const auto found = with_region(region);
    PALPATE_CHECK(found.ok());
    return view_of(found->regions[0], model);
  };
  // the slab's sides cancel, and its lower face is not in this half
  const RegionView upper = view("structures = [1]\nhalf = \"superior\"");
  EXPECT_TRUE(upper.centre_mm.isApprox(Eigen::Vector3d(10, 5, 1.5), 1e-9)) << upper.centre_mm.transpose();
  EXPECT_TRUE(upper.outward.isApprox(Eigen::Vector3d::UnitZ(), 1e-9)) << upper.outward.transpose();
  EXPECT_NEAR(upper.radius_mm, Eigen::Vector3d(9.75, 4.75, 0.25).norm(), 1e-9);
  // over the whole surface the normals cancel
  EXPECT_EQ(view("structures = [1, 2]").outward.norm(), 0);
  RegionInScene ball;
  ball.centre_mm = Eigen::Vector3d(1, 2, 3);
  ball.radius_mm = 4;
  EXPECT_EQ(view_of(ball, model).centre_mm, Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(view_of(ball, model).radius_mm, 4);
}

TEST(SurfacePatches, KeepTheirOrder) {
  SurfacePatches patches;
  for (const double x : {-7.5, 3.2, 0.1}) patches.add({x, -0.5, 2.5});
  patches.cover({3.4, -0.5, 2.5});
  const auto all = patches.all();
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[0].centre_mm, Eigen::Vector3d(-7.5, -0.5, 2.5));
  EXPECT_EQ(all[1].centre_mm, Eigen::Vector3d(3.5, -0.5, 2.5));
  EXPECT_EQ((std::array{all[0].covered, all[1].covered, all[2].covered}), (std::array{false, true, false}));
}

// reference: every patch whose cube is within half a millimetre of any contact
TEST(SurfacePatches, CoverNearbyPoints) {
  std::mt19937_64 random(test::test_seed());
  std::uniform_real_distribution<double> coordinate(-5, 5);
  std::vector<Eigen::Vector3d> cubes;
  SurfacePatches patches;
  for (int n = 0; n < 300; ++n) {
    const Eigen::Vector3d at(coordinate(random), coordinate(random), coordinate(random));
    const std::size_t before = patches.count();
    patches.add(at);
    if (patches.count() > before) cubes.emplace_back(at.array().floor());
  }
  std::vector<bool> covered(cubes.size());
  for (int n = 0; n < 200; ++n) {
    Eigen::Vector3d at(coordinate(random), coordinate(random), coordinate(random));
    if (n % 10 == 0) at = at.array().round();  // on cube boundaries
    patches.cover(at);
    for (std::size_t c = 0; c < cubes.size(); ++c) {
      const Eigen::Vector3d off =
          (cubes[c] - at).cwiseMax(at - cubes[c] - Eigen::Vector3d::Ones()).cwiseMax(0.0);
      if (off.norm() <= SurfacePatches::kWithin_mm) covered[c] = true;
    }
    ASSERT_EQ(patches.covered(), static_cast<std::size_t>(std::count(covered.begin(), covered.end(), true)));
  }
  EXPECT_GT(patches.covered(), 20u);
  EXPECT_LT(patches.covered(), patches.count());
}

TEST(SurfacePatches, PlacesFarAwayAreBorne) {
  SurfacePatches patches;
  for (const double far : {1e9, -1e9, 1e300}) {
    patches.add({far, 0, 0});
    patches.add({0, far, -far});
  }
  EXPECT_GE(patches.count(), 2u);
}

}  // namespace
}  // namespace palpate
