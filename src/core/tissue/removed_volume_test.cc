#include "palpate/tissue/removed_volume.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <random>

#include "contact/test_model.h"
#include "tissue/test_surfaces.h"

namespace palpate {
namespace {

using std::numbers::pi;
using testing::kBone;
using testing::kCartilage;
using testing::kFat;

// bone where z < 0 and cartilage above; fat, which is not felt, where x > 8; the grid's axes are rotated
Model blocks(const Eigen::Vector3d& spacing_mm, const Eigen::Matrix3d& direction) {
  Model model = testing::ball_model({3, 3, 3});
  Volume<LabelId> labels(testing::cube_grid(12, spacing_mm, direction));
  const auto X_PatientVoxel = labels.geometry().X_PatientVoxel();
  const auto& dims = labels.geometry().dims;
  for (int k = 0; k < dims[2]; ++k)
    for (int j = 0; j < dims[1]; ++j)
      for (int i = 0; i < dims[0]; ++i) {
        const Point<Patient> p = X_PatientVoxel * Point<Voxel>(i, j, k);
        labels.at(i, j, k) = p.x() > 8 ? kFat : p.z() < 0 ? kBone : kCartilage;
      }
  model.labels = label_bricks(labels);
  return model;
}

double capsule_mm3(const Sweep& sweep) {
  const double r = sweep.radius_mm;
  return pi * r * r * ((sweep.to - sweep.from).norm() + 4.0 / 3 * r);
}

TEST(RemovedVolume, BallAndCapsuleHaveTheirExactVolume) {
  for (const double spacing_mm : {0.3, 0.6})
    for (const double turn : {0.0, 0.5}) {
      const Model model = blocks(Eigen::Vector3d::Constant(spacing_mm), testing::turned_by(turn));
      for (const double radius_mm : {2.0, 3.0})
        for (const double distance_mm : {0.0, 2.5}) {
          const Sweep sweep{{-1.13, 0.27, -5.4}, {-1.13 + distance_mm, 0.27, -5.4}, radius_mm};
          RemovedVolume removed(model);
          removed.add(std::vector<Cut>{{0, sweep}});
          const auto volumes = removed.by_label_mm3();
          ASSERT_EQ(volumes.size(), 1u);
          EXPECT_NEAR(volumes.at(kBone) / capsule_mm3(sweep), 1, 0.01) << spacing_mm << " " << radius_mm;
        }
    }
}

TEST(RemovedVolume, VolumeIsPerTouchableStructure) {
  // the boundary lies on faces of voxels
  Model model = blocks({0.6, 0.6, 0.6}, Eigen::Matrix3d::Identity());
  const GridGeometry& grid = model.labels->geometry();
  const double z = (grid.X_PatientVoxel() * Point<Voxel>(0, 0, grid.dims[2] / 2)).z();
  const double face_mm = z < 0 ? z + 0.3 : z - 0.3;
  const Sweep half{{-2, 0, face_mm}, {1, 0, face_mm}, 2}, beyond{{8.0 + 4, 0, 5}, {8.0 + 5, 0, 5}, 2};
  RemovedVolume removed(model);
  removed.add(std::vector<Cut>{{0, half}, {0, beyond}});
  const auto volumes = removed.by_label_mm3();
  ASSERT_EQ(volumes.size(), 2u);
  for (const LabelId label : {kBone, kCartilage})
    EXPECT_NEAR(volumes.at(label) / (0.5 * capsule_mm3(half)), 1, 0.015) << label;
}

TEST(RemovedVolume, RepeatedSweepsCountOnceInAnyOrder) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> coordinate(-14, 14);
  const Model model = blocks({0.6, 0.75, 1}, testing::turned_by(0.5));
  std::vector<Cut> cuts;
  for (int n = 0; n < 30; ++n) {
    const Point<Patient> from(coordinate(random), coordinate(random), coordinate(random));
    cuts.push_back({0, {from, from + Vector<Patient>(0.2, 0.1, 0), 0.5 + 0.05 * n}});
    // every third one is a cone
    if (n % 3 == 0) {
      cuts.back().sweep.axis_mm = {1, -2, 3};
      cuts.back().sweep.end_radius_mm = 0.5 + 0.1 * n;
    }
  }
  RemovedVolume once(model), again(model);
  once.add(cuts);
  std::shuffle(cuts.begin(), cuts.end(), random);
  again.add(cuts);
  again.add(std::span(cuts).first(10));
  EXPECT_EQ(once.by_label_mm3(), again.by_label_mm3());

  // oracle: point by point
  const GridGeometry& grid = model.labels->geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  std::map<LabelId, double> expected;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i) {
        const LabelId label = model.labels->at(i, j, k);
        if (!model.is_touchable(label)) continue;
        for (int sample_n = 0; sample_n < 64; ++sample_n) {
          const auto part = [](int n) { return -0.375 + 0.25 * n; };
          const Point<Patient> at =
              X_PatientVoxel *
              Point<Voxel>(i + part(sample_n & 3), j + part(sample_n >> 2 & 3), k + part(sample_n >> 4));
          if (std::ranges::any_of(cuts,
                                  [&](const Cut& cut) { return SweptShape(cut.sweep).depth_mm(at) > 0; }))
            expected[label] += grid.spacing_mm.prod() / 64;
        }
      }
  const auto volumes = once.by_label_mm3();
  std::map<LabelId, double> by_positions;
  once.for_each_swept([&](int i, int j, int k, LabelId label, std::uint64_t samples) {
    EXPECT_EQ(label, model.labels->at(i, j, k));
    by_positions[label] += std::popcount(samples) * RemovedVolume::sample_mm3(grid);
    // the first removed point lies in a sweep
    const int first = std::countr_zero(samples);
    const Point<Patient> at = X_PatientVoxel * RemovedVolume::sample_point(i, j, k, first);
    EXPECT_TRUE(
        std::ranges::any_of(cuts, [&](const Cut& cut) { return SweptShape(cut.sweep).depth_mm(at) > 0; }));
  });
  ASSERT_EQ(by_positions.size(), volumes.size());
  for (const auto& [label, mm3] : by_positions) EXPECT_NEAR(mm3, volumes.at(label), 1e-6 * mm3);
  ASSERT_EQ(volumes.size(), expected.size());
  for (const auto& [label, mm3] : expected) EXPECT_NEAR(volumes.at(label), mm3, 1e-6 * mm3);
  // the samples of a voxel are those of the iteration, and none outside the volume
  std::size_t swept = 0;
  once.for_each_swept([&](int i, int j, int k, LabelId, std::uint64_t samples) {
    EXPECT_EQ(once.swept_samples(i, j, k), samples);
    ++swept;
  });
  EXPECT_GT(swept, 0u);
  for (const int beyond : {-1, 1000}) EXPECT_EQ(once.swept_samples(beyond, 2, 2), 0u);
}

TEST(RemovedVolume, UndoneSweepsAreSubtracted) {
  const unsigned seed = std::random_device()();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const auto within = [&](double largest) {
    return std::uniform_real_distribution<double>(-largest, largest)(random);
  };
  const Model model = blocks({0.6, 0.6, 0.6}, Eigen::Matrix3d::Identity());
  RemovedVolume removed(model);
  EXPECT_FALSE(removed.undo());
  EXPECT_FALSE(removed.redo());
  std::vector<std::vector<Cut>> done, undone;
  std::uint32_t stroke = 0;
  for (int n = 0; n < 60; ++n) {
    if (const unsigned action = random() % 4; action < 2) {
      // including overlapping ones
      std::vector<Cut> cuts;
      for (int sweeps = 0; sweeps < 3; ++sweeps) {
        const Point<Patient> at(within(6), within(3), within(3));
        cuts.push_back({0, {at, at + Vector<Patient>(within(1), within(1), 0), 1.5, stroke}});
      }
      ++stroke;
      removed.add(std::span(cuts).first(1));
      removed.add(std::span(cuts).last(2));
      done.push_back(cuts);
      undone.clear();
    } else {
      auto &from = action == 2 ? done : undone, &to = action == 2 ? undone : done;
      ASSERT_EQ(action == 2 ? removed.undo() : removed.redo(), !from.empty());
      if (from.empty()) continue;
      to.push_back(from.back());
      from.pop_back();
    }
    RemovedVolume oracle(model);
    for (const std::vector<Cut>& cuts : done) oracle.add(cuts);
    ASSERT_EQ(removed.by_label_mm3(), oracle.by_label_mm3()) << n;
  }
}

TEST(RemovedVolume, ProtectedStructureHasNoRemovedVolume) {
  Model model = blocks(Eigen::Vector3d::Constant(0.5), testing::turned_by(0));
  const std::vector<Cut> cuts{{0, {{0, 0, 4}, {0, 0, 1}, 2}}};
  RemovedVolume alarmed(model);
  alarmed.add(cuts);
  EXPECT_GT(alarmed.by_label_mm3().at(kBone), 1);
  model.tissues[static_cast<std::size_t>(model.tissue_of_label[kBone])].protection = Protection::kBlock;
  RemovedVolume stored(model);
  stored.add(cuts);
  EXPECT_EQ(stored.by_label_mm3().count(kBone), 0u);
  EXPECT_GT(stored.by_label_mm3().at(kCartilage), 1);
}

}  // namespace
}  // namespace palpate
