#include "palpate/tissue/carving.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <iostream>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "tissue/test_surfaces.h"

namespace palpate {
namespace {

using testing::kStep_mm;
using testing::slab;
constexpr double kReach_mm = testing::kCarvedReach_mm;

double ball(const Eigen::Vector3d& p) {
  return p.norm() - 7;
}
std::vector<Sweep> random_sweeps(std::mt19937& random, int count) {
  std::uniform_real_distribution<double> coordinate(-8, 8), step(-2, 2), radius(0.4, 2.5);
  std::vector<Sweep> sweeps;
  for (int n = 0; n < count; ++n) {
    Sweep sweep;
    sweep.from = Point<Patient>(coordinate(random), coordinate(random), coordinate(random));
    // some are stationary
    sweep.to = sweep.from;
    if (n % 3 != 0) sweep.to += Vector<Patient>(step(random), step(random), step(random));
    sweep.radius_mm = radius(random);
    // some are cylinders and cones
    if (n % 2 != 0) {
      sweep.axis_mm = {step(random), step(random), 2 * step(random)};
      sweep.end_radius_mm = n % 4 == 1 ? sweep.radius_mm : radius(random);
    }
    sweeps.push_back(sweep);
  }
  return sweeps;
}

// implementation of CarvedSurface's documentation, voxel by voxel
class CarvingOracle {
 public:
  CarvingOracle(const SignedField& made, std::span<const Sweep> sweeps)
      : made_(made), grid_(made.geometry()) {
    const auto X_PatientVoxel = grid_.X_PatientVoxel();
    for (int k = 0; k < grid_.dims[2]; ++k)
      for (int j = 0; j < grid_.dims[1]; ++j)
        for (int i = 0; i < grid_.dims[0]; ++i) {
          const Eigen::Vector3d at = (X_PatientVoxel * Point<Voxel>(i, j, k)).eigen();
          double depth_mm = -kReach_mm;
          for (const Sweep& sweep : sweeps) {
            // sweep_test.cc has an oracle for these
            if (!sweep.is_of_ball()) {
              depth_mm = std::max(depth_mm, SweptShape(sweep).depth_mm(Point<Patient>(at)));
              continue;
            }
            const Eigen::Vector3d displacement = sweep.to.eigen() - sweep.from.eigen(),
                                  from = at - sweep.from.eigen();
            const double part =
                displacement.norm() > 0
                    ? std::clamp(from.dot(displacement) / displacement.squaredNorm(), 0.0, 1.0)
                    : 0.0;
            depth_mm = std::max(depth_mm, sweep.radius_mm - (from - part * displacement).norm());
          }
          const int was = made.bricks().at(i, j, k);
          was_.push_back(was);
          is_.push_back(
              std::max<int>(was, static_cast<int>(std::lround(std::min(depth_mm, kReach_mm) / kStep_mm))));
        }
    near_made_ = near(was_);
    near_ = near(is_);
  }

  int at(int i, int j, int k) const {
    const std::size_t n = grid_.offset(i, j, k);
    if (is_beside(is_, i, j, k)) return is_[n];
    int steps = away(near_, i, j, k);
    if (was_[n] >= 0) steps = was_[n] + std::max(0, steps - away(near_made_, i, j, k));
    return std::clamp(steps, is_[n], static_cast<int>(kReach_mm / kStep_mm));
  }

 private:
  // whether a corner of the surrounding cells is inside
  bool is_beside(const std::vector<int>& values, int i, int j, int k) const {
    for (int c = std::max(0, k - 1); c <= std::min(k + 1, grid_.dims[2] - 1); ++c)
      for (int b = std::max(0, j - 1); b <= std::min(j + 1, grid_.dims[1] - 1); ++b)
        for (int a = std::max(0, i - 1); a <= std::min(i + 1, grid_.dims[0] - 1); ++a)
          if (values[grid_.offset(a, b, c)] < 0) return true;
    return false;
  }
  struct Near {
    int i, j, k;
    double distance_mm;
  };
  // voxels from which distances are measured
  std::vector<Near> near(const std::vector<int>& values) const {
    std::vector<Near> near;
    for (int k = 0; k < grid_.dims[2]; ++k)
      for (int j = 0; j < grid_.dims[1]; ++j)
        for (int i = 0; i < grid_.dims[0]; ++i) {
          const double distance_mm = values[grid_.offset(i, j, k)] * kStep_mm;
          if (distance_mm >= -grid_.spacing_mm.norm() && is_beside(values, i, j, k))
            near.push_back({i, j, k, distance_mm});
        }
    return near;
  }
  int away(const std::vector<Near>& near, int i, int j, int k) const {
    double min_mm = kReach_mm;
    for (const Near& one : near) {
      const Eigen::Vector3d displacement =
          Eigen::Vector3d(one.i - i, one.j - j, one.k - k).cwiseProduct(grid_.spacing_mm);
      min_mm = std::min(min_mm, displacement.norm() + one.distance_mm);
    }
    return static_cast<int>(std::lround(min_mm / kStep_mm));
  }

  const SignedField& made_;
  const GridGeometry& grid_;
  std::vector<int> was_, is_;
  std::vector<Near> near_made_, near_;
};

TEST(CarvedSurface, EveryVoxelMatchesTheDefinition) {
  std::mt19937 random(test::test_seed());
  RecordProperty("seed", static_cast<int>(test::test_seed()));
  for (const auto& [spacing_mm, turn] :
       {std::pair(Eigen::Vector3d(0.9, 0.7, 1.1), 0.4), std::pair(Eigen::Vector3d(0.8, 0.8, 1.6), 0.0)}) {
    const auto made = testing::surface_to_carve(10, spacing_mm, ball, testing::turned_by(turn));
    const std::vector<Sweep> sweeps = random_sweeps(random, 6);
    const CarvedSurface carved = CarvedSurface(made).with(sweeps);
    const CarvingOracle oracle(made->distance_field(), sweeps);
    const Bricks<std::int16_t>& voxels = carved.surface()->distance_field().bricks();
    const GridGeometry& grid = voxels.geometry();
    int different = 0, moved = 0;
    for (int k = 0; k < grid.dims[2]; ++k)
      for (int j = 0; j < grid.dims[1]; ++j)
        for (int i = 0; i < grid.dims[0]; ++i) {
          const int expected = oracle.at(i, j, k), is = voxels.at(i, j, k);
          // the oracle computes in double, and steps are rounded
          EXPECT_LE(std::abs(is - expected), 1) << i << ' ' << j << ' ' << k;
          if (is != expected) ++different;
          if (is != made->distance_field().bricks().at(i, j, k)) ++moved;
        }
    EXPECT_GT(moved, 500);
    EXPECT_LT(different, moved / 50);
  }
}

TEST(CarvedSurface, ResultIsIndependentOfOrderAndVersions) {
  std::mt19937 random(test::test_seed());
  std::cout << "seed " << test::test_seed() << '\n';
  const auto made = testing::surface_to_carve(10, {0.5, 0.6, 0.8}, ball, testing::turned_by(0.3));
  for (int round = 0; round < 5; ++round) {
    std::vector<Sweep> sweeps = random_sweeps(random, 12);
    const CarvedSurface once = CarvedSurface(made).with(sweeps);
    std::shuffle(sweeps.begin(), sweeps.end(), random);
    CarvedSurface steps(made);
    for (std::size_t n = 0; n < sweeps.size();) {
      const std::size_t count = std::min<std::size_t>(1 + random() % 3, sweeps.size() - n);
      steps = steps.with(std::span(sweeps).subspan(n, count));
      n += count;
    }
    EXPECT_EQ(steps.surface()->content_hash(), once.surface()->content_hash());
    EXPECT_EQ(steps.surface()->max_gradient(), once.surface()->max_gradient());
    EXPECT_NE(once.surface()->content_hash(), made->content_hash());
  }
}

TEST(CarvedSurface, EmptySweepsChangeNothing) {
  const auto made = testing::surface_to_carve(10, {0.5, 0.5, 0.5}, ball);
  const CarvedSurface whole(made);
  EXPECT_EQ(whole.with({}).surface(), made);
  const double far = 1e6;
  const std::vector<Sweep> beside{{Point<Patient>(0, 0, 9.5), Point<Patient>(2, 0, 9.5), 1},
                                  {Point<Patient>(far, 0, 0), Point<Patient>(far, 1, 0), 2}};
  const CarvedSurface touched = whole.with(beside);
  EXPECT_EQ(touched.surface()->content_hash(), made->content_hash());

  // outside the range of a cut, the same bricks
  const std::vector<Sweep> cut{{Point<Patient>(6, 0, 0), Point<Patient>(6, 1, 0), 1}};
  const CarvedSurface carved = whole.with(cut);
  EXPECT_NE(carved.surface()->content_hash(), made->content_hash());
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> coordinate(-9, 9);
  int found = 0;
  for (int n = 0; n < 20000; ++n) {
    const Point<Patient> p(coordinate(random), coordinate(random), coordinate(random));
    const Vector<Patient> from = p - Point<Patient>(6, 0.5, 0);
    if (from.norm() < 1.5 + kReach_mm + 2) continue;
    ++found;
    EXPECT_EQ(carved.surface()->distance_mm(p), made->distance_mm(p));
    EXPECT_EQ(carved.surface()->outward(p), made->outward(p));
  }
  EXPECT_GT(found, 5000);
}

TEST(CarvedSurface, EarlierVersionIsUnchangedByLaterCuts) {
  const CarvedSurface whole(testing::surface_to_carve(10, {0.5, 0.5, 0.5}, ball));
  const std::vector<Sweep> first{{Point<Patient>(6, 0, 0), Point<Patient>(6, 2, 0), 1}};
  const std::vector<Sweep> second{{Point<Patient>(0, 6, 0), Point<Patient>(0, 6, 2), 1.5}};
  const CarvedSurface one = whole.with(first);
  const std::uint64_t hash = one.surface()->content_hash();
  const CarvedSurface two = one.with(second);
  EXPECT_NE(two.surface()->content_hash(), hash);
  EXPECT_EQ(one.surface()->content_hash(), hash);
  EXPECT_EQ(one.with(second).surface()->content_hash(), two.surface()->content_hash());
}

struct Case {
  Eigen::Vector3d spacing_mm;
  double turn;
};
const Case kCases[] = {
    {{0.3, 0.3, 0.3}, 0}, {{0.6, 0.6, 0.6}, 0}, {{0.6, 0.6, 0.6}, 0.5}, {{0.36, 0.36, 0.7}, 0.8}};

TEST(CarvedSurface, MilledBedIsFlatAndClear) {
  // parallel passes, as in milling a bed: the ball's centre is free at the height of the passes
  const double radius_mm = 2, separation_mm = 0.4;
  for (const auto& [spacing_mm, turn] : kCases) {
    const auto made = testing::surface_to_carve(18, spacing_mm, slab(-5, 0, 9), testing::turned_by(turn));
    std::vector<Sweep> sweeps;
    for (double y = -5; y <= 5; y += separation_mm)
      sweeps.push_back({Point<Patient>(-5, y, 1), Point<Patient>(5, y, 1), radius_mm});
    const CarvedSurface carved = CarvedSurface(made).with(sweeps);
    const Surface& bed = *carved.surface();
    const double cusp_mm = separation_mm * separation_mm / (8 * radius_mm), voxel_mm = spacing_mm.maxCoeff();
    std::mt19937 random(test::test_seed());
    std::uniform_real_distribution<double> across(-3, 3), height(-1, 2.5);
    double max_mm = 0, most_degrees = 0;
    for (int n = 0; n < 3000; ++n) {
      const Point<Patient> p(across(random), across(random), height(random));
      max_mm = std::max(max_mm, std::abs(bed.distance_mm(p) - (p.z() + 1)));
      if (p.z() < 0) continue;
      most_degrees =
          std::max(most_degrees, std::acos(std::min(1.0, bed.outward(p).z())) * 180 / std::numbers::pi);
    }
    EXPECT_LT(max_mm, cusp_mm + 0.12 * voxel_mm) << spacing_mm.transpose() << ", turned by " << turn;
    EXPECT_LT(most_degrees, 6) << spacing_mm.transpose() << ", turned by " << turn;
    std::cout << "  bed at " << spacing_mm.transpose() << " mm, turned by " << turn << ": distance within "
              << max_mm << " mm, normal within " << most_degrees << " degrees, slope " << bed.max_gradient()
              << '\n';
  }
}

TEST(CarvedSurface, CavityHasTheSweptWallsAndNormals) {
  const double radius_mm = 2.5;
  for (const auto& [spacing_mm, turn] : kCases) {
    // through a plate, whose middle plane has no gradient
    const auto made = testing::surface_to_carve(18, spacing_mm, slab(-2, 2, 9), testing::turned_by(turn));
    const std::vector<Sweep> sweep{{Point<Patient>(0.2, 0.1, 6), Point<Patient>(0.2, 0.1, -6), radius_mm}};
    const CarvedSurface carved = CarvedSurface(made).with(sweep);
    const Surface& hole = *carved.surface();
    std::mt19937 random(test::test_seed());
    std::uniform_real_distribution<double> angle(0, 2 * std::numbers::pi), height(-1, 1), from(0.5, 2.5);
    double max_mm = 0, all_degrees = 0, most_degrees = 0;
    int count = 0;
    for (int n = 0; n < 3000; ++n) {
      const double a = angle(random), r = from(random);
      const Vector<Patient> out(std::cos(a), std::sin(a), 0);
      const Point<Patient> p = Point<Patient>(0.2, 0.1, height(random)) + out * r;
      max_mm = std::max(max_mm, std::abs(hole.distance_mm(p) - (radius_mm - r)));
      const double degrees =
          std::acos(std::clamp(hole.outward(p).dot(out * -1.0), -1.0, 1.0)) * 180 / std::numbers::pi;
      if (r < 1.5) continue;
      all_degrees += degrees;
      most_degrees = std::max(most_degrees, degrees);
      ++count;
    }
    std::cout << "  hole at " << spacing_mm.transpose() << " mm, turned by " << turn << ": distance within "
              << max_mm << " mm, normal " << all_degrees / count << " degrees, most " << most_degrees << '\n';
    EXPECT_LT(max_mm, 0.25 * spacing_mm.maxCoeff());
    EXPECT_LT(all_degrees / count, 3);
    EXPECT_LT(most_degrees, 12);
  }
}

TEST(CarvedSurface, SlopesAreWithinMaxGradient) {
  std::mt19937 random(test::test_seed());
  const auto made = testing::surface_to_carve(10, {0.5, 0.6, 0.8}, ball, testing::turned_by(0.3));
  const CarvedSurface carved = CarvedSurface(made).with(random_sweeps(random, 12));
  const Surface& surface = *carved.surface();
  // where three sweeps meet in a point, each axis may contribute its slope
  EXPECT_LT(surface.max_gradient(), 2.2);
  std::uniform_real_distribution<double> coordinate(-9, 9);
  for (int n = 0; n < 20000; ++n) {
    const Point<Patient> p(coordinate(random), coordinate(random), coordinate(random));
    const Vector<Patient> step(1e-4 * coordinate(random), 1e-4 * coordinate(random),
                               1e-4 * coordinate(random));
    EXPECT_LE(std::abs(surface.distance_mm(p + step) - surface.distance_mm(p)),
              surface.max_gradient() * step.norm() + 1e-12);
    EXPECT_LE(surface.lower_bound_mm(p), surface.distance_mm(p) + 1e-9);
  }
}

TEST(CarvedSurface, ProtectedStructureRemainsForAnyOrder) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  const Eigen::Vector3d spacing_mm(0.5, 0.6, 0.7);
  const auto made = testing::surface_to_carve(12, spacing_mm, ball, testing::turned_by(0.4));
  const Eigen::Vector3d centre(3, -2, 4);
  // on a grid of its own that contains all of it
  const auto stored = testing::surface_to_carve(
      12, Eigen::Vector3d::Constant(0.5), [&](const Eigen::Vector3d& p) { return (p - centre).norm() - 3; });
  std::vector<Sweep> sweeps = random_sweeps(random, 30);
  sweeps.push_back({{3, -2, 4}, {4, -2, 5}, 2.5});
  const CarvedSurface all = CarvedSurface(made).with(sweeps),
                      but = CarvedSurface(made, {stored}).with(sweeps);
  CarvedSurface one_by_one(made, {stored});
  for (auto sweep = sweeps.rbegin(); sweep != sweeps.rend(); ++sweep)
    one_by_one = one_by_one.with({{*sweep}});
  EXPECT_EQ(one_by_one.surface()->content_hash(), but.surface()->content_hash());

  std::uniform_real_distribution<double> coordinate(-8, 8);
  int retained_points = 0, saved = 0, gone = 0;
  for (int n = 0; n < 100'000; ++n) {
    const Point<Patient> at(coordinate(random), coordinate(random), coordinate(random));
    // within a cell's length of the protected surface the result is not specified
    const double from_retained_mm = stored->distance_mm(at), cell_mm = spacing_mm.norm();
    const bool was = made->distance_mm(at) < -0.05, is = but.surface()->distance_mm(at) < 0;
    if (from_retained_mm < -0.3 && was) {
      ++retained_points;
      saved += all.surface()->distance_mm(at) > 0 ? 1 : 0;
      ASSERT_TRUE(is) << at.eigen().transpose();
    }
    if (from_retained_mm > cell_mm && all.surface()->distance_mm(at) > cell_mm) {
      gone += was ? 1 : 0;
      ASSERT_FALSE(is) << at.eigen().transpose();
    }
  }
  EXPECT_GT(retained_points, 500);
  EXPECT_GT(saved, 0);
  EXPECT_GT(gone, 100);
}

}  // namespace
}  // namespace palpate
