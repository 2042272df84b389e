#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>

#include "palpate/rendering/rendering.h"

namespace palpate {
namespace {

constexpr std::array<int, 3> kDims{44, 37, 29};

GridGeometry oblique_grid() {
  GridGeometry grid;
  grid.dims = kDims;
  grid.spacing_mm = Eigen::Vector3d(0.5, 0.6, 1.1);
  grid.origin = {-7, 12, 30};
  grid.direction = Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
  return grid;
}

/// Balls with different labels.
Volume<LabelId> balls(std::mt19937& random) {
  Volume<LabelId> labels(oblique_grid());
  const auto within = [&](int n) { return std::uniform_real_distribution<double>(0, n)(random); };
  for (LabelId label = 1; label <= 6; ++label) {
    const Eigen::Vector3d centre(within(kDims[0]), within(kDims[1]), within(kDims[2]));
    const double radius = 4 + within(8);
    for (int k = 0; k < kDims[2]; ++k)
      for (int j = 0; j < kDims[1]; ++j)
        for (int i = 0; i < kDims[0]; ++i)
          if ((Eigen::Vector3d(i, j, k) - centre).norm() < radius) labels.at(i, j, k) = label;
  }
  return labels;
}

TEST(MovedLabels, AreLookedUpWhereTissueLay) {
  const unsigned seed = std::random_device{}();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  int differing = 0;
  for (int run = 0; run < 8; ++run) {
    const auto labels = label_bricks(balls(random));
    const GridGeometry& grid = labels->geometry();
    const auto X_PatientVoxel = grid.X_PatientVoxel();
    const auto X_VoxelPatient = X_PatientVoxel.inverse();
    // a dent with a slope of at most three quarters
    const auto any = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    const Point<Patient> centre =
        X_PatientVoxel * Point<Voxel>(any(0, kDims[0]), any(0, kDims[1]), any(0, kDims[2]));
    const double width_mm = any(2, 5), depth_mm = any(0.2, 1.2) * width_mm;
    const Vector<Patient> displacement = Vector<Patient>(any(-1, 1), any(-1, 1), any(-1, 1)).normalized();
    const auto moved = [&](const Point<Patient>& at) {
      return displacement * (depth_mm * std::exp(-0.5 * std::pow((at - centre).norm() / width_mm, 2)));
    };
    const PatchOf<LabelId> patch = moved_labels(*labels, moved, {{0, 0, 0}, grid.dims});
    ASSERT_GT(patch.box.voxel_count(), 0u);
    const Bricks<LabelId> observed = labels->with(patch);
    for (int k = 0; k < kDims[2]; ++k)
      for (int j = 0; j < kDims[1]; ++j)
        for (int i = 0; i < kDims[0]; ++i) {
          const Point<Patient> at = X_PatientVoxel * Point<Voxel>(i, j, k);
          const Eigen::Vector3d from = (X_VoxelPatient * rest_position(at, moved)).eigen().array().round();
          const auto whole = from.cast<int>().eval();
          const LabelId expected = grid.contains(whole[0], whole[1], whole[2])
                                       ? labels->at(whole[0], whole[1], whole[2])
                                       : LabelId{0};
          ASSERT_EQ(observed.at(i, j, k), expected) << i << " " << j << " " << k;
          differing += observed.at(i, j, k) != labels->at(i, j, k);
        }
  }
  EXPECT_GT(differing, 0);
}

TEST(MovedLabels, AreEmptyAtRest) {
  std::mt19937 random(1);
  const auto labels = label_bricks(balls(random));
  const auto nothing = [](const Point<Patient>&) { return Vector<Patient>(); };
  EXPECT_EQ(moved_labels(*labels, nothing, {{0, 0, 0}, kDims}).box.voxel_count(), 0u);
  // displacements outside the given box are ignored
  const auto all = [](const Point<Patient>&) { return Vector<Patient>(3, 0, 0); };
  const VoxelBox within{{5, 6, 7}, {9, 10, 11}};
  EXPECT_EQ(moved_labels(*labels, all, within).box, within);
}

}  // namespace
}  // namespace palpate
