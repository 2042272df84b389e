#include "palpate/palpation/free_path.h"

#include <gtest/gtest.h>

#include "contact/test_model.h"

namespace palpate {
namespace {

// labels of a wall at x = 30 with a hole, in a volume of 60 mm
Model wall_model(bool hole) {
  Model model = testing::ball_model({2, 2, 2});
  GridGeometry grid;
  grid.dims = {60, 60, 60};
  Volume<LabelId> labels(grid);
  for (int k = 0; k < 60; ++k)
    for (int j = 0; j < 60; ++j)
      if (!hole || std::abs(j - 45) > 4 || std::abs(k - 20) > 4) labels.at(30, j, k) = testing::kBone;
  model.labels = label_bricks(labels);
  return model;
}

bool meets_bone(const Model& model, const Point<Patient>& p) {
  const Point<Voxel> v = model.labels->geometry().X_PatientVoxel().inverse() * p;
  return model.labels->anywhere(static_cast<int>(std::lround(v.x())), static_cast<int>(std::lround(v.y())),
                                static_cast<int>(std::lround(v.z()))) == testing::kBone;
}

TEST(FreeSpace, PathLeadsThroughTheHole) {
  const Model model = wall_model(true);
  const Point<Patient> from(10, 30, 30), to(50, 30, 30);
  const auto path = FreeSpace(model).path(from, to);
  ASSERT_GE(path.size(), 3u);
  EXPECT_EQ(path.front(), from);
  EXPECT_EQ(path.back(), to);
  for (std::size_t i = 1; i < path.size(); ++i)
    for (double t = 0; t <= 1; t += 0.05)
      EXPECT_FALSE(meets_bone(model, path[i - 1] + (path[i] - path[i - 1]) * t));
}

TEST(FreeSpace, PathLeadsAroundTheVolumeWithoutAHole) {
  // the air around the patient is free: around the wall's edge, outside the volume
  const Model model = wall_model(false);
  const auto path = FreeSpace(model).path(Point<Patient>(10, 30, 30), Point<Patient>(50, 30, 30));
  ASSERT_FALSE(path.empty());
  for (const Point<Patient>& p : path) EXPECT_FALSE(meets_bone(model, p));
}

TEST(FreeSpace, PathKeepsClearanceWherePossible) {
  const Model model = testing::ball_model({1, 1, 1});
  const auto path = FreeSpace(model).path(Point<Patient>(-26, 0, 0), Point<Patient>(26, 0, 0));
  ASSERT_FALSE(path.empty());
  for (const Point<Patient>& p : path) EXPECT_GT(p.eigen().norm(), testing::kBoneRadius_mm + 3);
}

TEST(FreeSpace, FindsNoWayIntoAClosedShell) {
  Model model = testing::ball_model({1, 1, 1});
  Volume<LabelId> labels = model.labels->dense();
  const auto X = labels.geometry().X_PatientVoxel();
  for (int k = 0; k < labels.geometry().dims[2]; ++k)
    for (int j = 0; j < labels.geometry().dims[1]; ++j)
      for (int i = 0; i < labels.geometry().dims[0]; ++i)
        if ((X * Point<Voxel>(i, j, k)).eigen().norm() < 10) labels.at(i, j, k) = 0;
  model.labels = label_bricks(labels);
  EXPECT_TRUE(FreeSpace(model).path(Point<Patient>(26, 0, 0), Point<Patient>(0, 0, 0)).empty());
}

}  // namespace
}  // namespace palpate
