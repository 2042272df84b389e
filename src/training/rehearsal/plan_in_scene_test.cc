#include "palpate/rehearsal/plan_in_scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "contact/test_model.h"

namespace palpate {
namespace {

using std::numbers::pi;
using ::testing::AllOf;
using ::testing::HasSubstr;

PlanFile plan_of(const std::string& text) {
  const auto plan = parse_plan("title = \"p\"\n" + text, "plan.toml");
  PALPATE_CHECK(plan.ok());
  return *plan;
}

constexpr const char* kThreeShapes = R"([[trajectory]]
name = "t"
entry = [2, -1, 12]
target = [-1, 3, -4]
[[region]]
name = "sphere"
shape = "sphere"
trajectory = "t"
radius = 5
[[region]]
name = "cylinder"
shape = "cylinder"
trajectory = "t"
radius = 3
from = 1
depth = 12
[[region]]
name = "box"
shape = "box"
trajectory = "t"
from = -1
width = 6
height = 4
across = "left"
)";

TEST(PlanInScene, ShapesHaveTheirVolumesAndTheirPlaces) {
  const Model model = testing::ball_model({0.7, 0.6, 0.8});
  const auto plan = resolve_plan(plan_of(kThreeShapes), model);
  ASSERT_TRUE(plan) << plan.error().message();
  const PlanTrajectory& t = plan->file.trajectories[0];
  const auto volumes = planned_volumes(*plan, model);
  ASSERT_TRUE(volumes);
  EXPECT_NEAR(volumes->of_regions[0].at(testing::kBone) / (4.0 / 3 * pi * 125), 1, 0.01);
  EXPECT_NEAR(volumes->of_regions[1].at(testing::kBone) / (pi * 9 * 11), 1, 0.01);
  EXPECT_NEAR(volumes->of_regions[2].at(testing::kBone) / (24 * (t.length_mm() + 1)), 1, 0.01);
  // the regions overlap
  EXPECT_LT(volumes->of_plan.at(testing::kBone), volumes->of_regions[0].at(testing::kBone) +
                                                     volumes->of_regions[1].at(testing::kBone) +
                                                     volumes->of_regions[2].at(testing::kBone) - 50);

  // reference: direct evaluation, point by point
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const GridGeometry& grid = model.labels->geometry();
  const Eigen::Vector3d axis = t.axis().eigen();
  Eigen::Vector3d across(1, 0, 0);
  across = (across - axis * axis.x()).normalized();
  const Eigen::Vector3d third = axis.cross(across);
  for (int n = 0; n < 20'000; ++n) {
    const int i = static_cast<int>(random() % static_cast<unsigned>(grid.dims[0])),
              j = static_cast<int>(random() % static_cast<unsigned>(grid.dims[1])),
              k = static_cast<int>(random() % static_cast<unsigned>(grid.dims[2]));
    std::array<std::uint64_t, 3> expected{};
    for (int index = 0; index < RemovedVolume::kSamples; ++index) {
      const Eigen::Vector3d at =
          (grid.X_PatientVoxel() * RemovedVolume::sample_point(i, j, k, index)).eigen();
      const Eigen::Vector3d from_entry = at - t.entry.eigen();
      const double along = from_entry.dot(axis);
      const std::uint64_t bit = std::uint64_t{1} << index;
      if ((at - t.target.eigen()).norm() < 5) expected[0] |= bit;
      if (along > 1 && along < 12 && (from_entry - along * axis).norm() < 3) expected[1] |= bit;
      if (along > -1 && along < t.length_mm() && std::abs(from_entry.dot(across)) < 3 &&
          std::abs(from_entry.dot(third)) < 2)
        expected[2] |= bit;
    }
    for (std::size_t region = 0; region < 3; ++region)
      EXPECT_EQ(plan->regions[region].samples_in(grid, i, j, k, testing::kBone), expected[region])
          << region << " at " << i << " " << j << " " << k;
  }
}

TEST(PlanInScene, RegionRequiresCuttableTissue) {
  Model model = testing::ball_model({1, 1, 1}, 1, 2);
  const auto plan = resolve_plan(plan_of(R"([[region]]
name = "shell"
structures = ["shell"]
[[region]]
name = "all"
structures = ["shell", "ball", "fat"]
)"),
                                 model);
  ASSERT_TRUE(plan) << plan.error().message();
  const Volume<LabelId> labels = model.labels->dense();
  const auto count = [&](LabelId label) {
    return static_cast<double>(std::ranges::count(labels.voxels(), label));
  };
  const auto volumes = planned_volumes(*plan, model);
  ASSERT_TRUE(volumes);
  EXPECT_EQ(volumes->of_regions[0], (VolumesByLabel{{testing::kCartilage, count(testing::kCartilage)}}));
  // fat is not touchable; overlaps of two regions count once
  EXPECT_EQ(volumes->of_regions[1].size(), 2u);
  EXPECT_EQ(volumes->of_plan, volumes->of_regions[1]);
  model.tissues[0].protection = Protection::kBlock;
  const auto stored = planned_volumes(*plan, model);
  ASSERT_TRUE(stored);
  EXPECT_EQ(stored->of_plan, volumes->of_regions[0]);
}

TEST(PlanInScene, StructuresThatAreNotThereAreErrorsWithTheirLine) {
  const Model model = testing::ball_model({1, 1, 1});
  const auto refused = [&](const std::string& text) {
    const auto plan = resolve_plan(plan_of(text), model);
    return plan ? "accepted" : plan.error().message();
  };
  EXPECT_THAT(refused("[[keep_away]]\nstructures = [\"bal\"]\ndistance = 2\n"),
              AllOf(HasSubstr("plan.toml:2: the scene has no structure \"bal\""),
                    HasSubstr("did you mean \"ball\"?"), HasSubstr("its structures are ball, shell, fat")));
  EXPECT_THAT(refused("[[region]]\nname = \"r\"\nstructures = [77]\n"),
              HasSubstr("the scene has no label 77"));
  EXPECT_THAT(
      refused("[[trajectory]]\nname = \"t\"\nentry = [0,0,0]\ntarget = [0,0,9]\nenters = [\"shell\"]\n"),
      AllOf(HasSubstr("plan.toml:2: the structure \"shell\" has no voxel"), HasSubstr("give another one")));
  const auto twice = resolve_plan(plan_of("[[keep_away]]\nstructures = [\"ball\"]\ndistance = 2\n"
                                          "[[keep_away]]\nstructures = [5, \"fat\"]\ndistance = 1\n"),
                                  model);
  ASSERT_TRUE(twice);
  EXPECT_EQ(twice->distances_mm, (std::map<LabelId, double>{{testing::kBone, 2}, {testing::kFat, 1}}));
  Model bare = model;
  bare.labels = nullptr;
  EXPECT_THAT(
      resolve_plan(plan_of("[[keep_away]]\nstructures = [5]\ndistance = 1\n"), bare).error().message(),
      HasSubstr("no label map"));
}

}  // namespace
}  // namespace palpate
