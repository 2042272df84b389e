#include <gtest/gtest.h>

#include <iostream>

#include "sampling/label_sphere_test_support.h"

namespace palpate {
namespace {

using test::make_grid;

constexpr unsigned kGaussianSeed = 4711;

GaussianSphere gaussian_sphere_of(const LabelVoxels& voxels, double sigma) {
  return GaussianSphere::make(voxels, sigma).value();
}

/// The published formula with std::exp, and seven independent evaluations.
FieldSample formula(const LabelVoxels& voxels, double sigma, const Point<Patient>& p) {
  const Eigen::Vector3d x = (voxels.X_VoxelPatient() * p).eigen();
  const auto value = [&](const Eigen::Vector3d& at) {
    double sum = 0;
    const Eigen::Vector3i nearest = (at.array() + 0.5).floor().matrix().cast<int>();
    for (int k = -2; k <= 2; ++k) {
      for (int j = -2; j <= 2; ++j) {
        for (int i = -2; i <= 2; ++i) {
          const Eigen::Vector3i voxel = nearest + Eigen::Vector3i(i, j, k);
          if (!voxels.contains(voxel[0], voxel[1], voxel[2])) continue;
          const double d2 = (voxel.cast<double>() - at).squaredNorm();
          sum += std::pow(2 * std::numbers::pi * sigma * sigma, -1.5) * std::exp(-d2 / (2 * sigma * sigma));
        }
      }
    }
    return sum;
  };
  Eigen::Vector3d gradient;
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d h = Eigen::Vector3d::Unit(axis);
    gradient[axis] = (value(x + h) - value(x - h)) / 2;
  }
  const Eigen::Matrix3d matrix = voxels.geometry().X_PatientVoxel().linear();
  return {value(x), Vector<Patient>(matrix.transpose().fullPivLu().solve(gradient))};
}

/// Weight of a full plane of voxels at the end of the window, where the window shifts.
double plane_weight(double sigma) {
  return std::exp(-2.5 * 2.5 / (2 * sigma * sigma)) / (sigma * std::sqrt(2 * std::numbers::pi));
}

TEST(GaussianSphere, FastFormEqualsTheLiteralForm) {
  SCOPED_TRACE("seed " + std::to_string(kGaussianSeed));
  std::mt19937 random(kGaussianSeed);
  for (const auto& dims : {std::array{11, 9, 8}, std::array{3, 4, 2}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const auto labels = internal::random_labels(test::make_grid(dims, kind), random);
      const auto points = internal::random_points(labels->geometry(), 5, 300, random);
      for (const double sigma : {0.5, 0.8, 1.0, 2.0}) {
        for (const auto& voxels : {LabelVoxels(labels, {1, 2, 3}), LabelVoxels(labels, {1, 5, 40000}),
                                   LabelVoxels::mask(*labels, {4}), LabelVoxels(labels, {})}) {
          const GaussianSphere sphere = gaussian_sphere_of(voxels, sigma);
          for (const auto& p : points) {
            const FieldSample fast = sphere.sample(p), literal = sphere.sample_literal(p);
            ASSERT_NEAR(fast.value, literal.value, 1e-5) << sigma << " at " << p.eigen().transpose();
            // error per voxel, hence per mm over the minimum spacing
            ASSERT_LT((fast.gradient - literal.gradient).norm() * labels->geometry().min_spacing_mm(), 1e-5)
                << sigma << " at " << p.eigen().transpose();
          }
        }
      }
    }
  }
}

TEST(GaussianSphere, LiteralFormMatchesTheFormula) {
  SCOPED_TRACE("seed " + std::to_string(kGaussianSeed));
  std::mt19937 random(kGaussianSeed);
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = test::make_grid({9, 8, 7}, kind);
    const LabelVoxels voxels(internal::random_labels(grid, random), {1, 2, 40000});
    for (const double sigma : {0.5, 1.0, 2.0}) {
      const GaussianSphere sphere = gaussian_sphere_of(voxels, sigma);
      for (int n = 0; n < 400; ++n) {
        // not at half voxels, where the last bit determines the window
        Point<Voxel> x;
        for (int axis = 0; axis < 3; ++axis) x[axis] = std::uniform_real_distribution<double>(-4, 12)(random);
        const Point<Patient> p = grid.X_PatientVoxel() * x;
        const FieldSample expected = formula(voxels, sigma, p), sample = sphere.sample_literal(p);
        ASSERT_NEAR(sample.value, expected.value, 1e-5);
        ASSERT_LT((sample.gradient - expected.gradient).norm() * grid.min_spacing_mm(), 1e-5);
      }
    }
  }
}

TEST(GaussianSphere, WeightsDoNotSumToOneAsPublished) {
  const GridGeometry grid = test::make_grid({16, 16, 16}, 1);
  const auto full = label_bricks(Volume<LabelId>(grid, LabelId{1}));
  const GaussianSphere sphere = gaussian_sphere_of({full, {1}}, 1);
  double axis_sum = 0;
  for (int n = -2; n <= 2; ++n) axis_sum += std::exp(-n * n / 2.0) / std::sqrt(2 * std::numbers::pi);
  const FieldSample centre = sphere.sample(grid.X_PatientVoxel() * Point<Voxel>(8, 8, 8));
  EXPECT_NEAR(centre.value, axis_sum * axis_sum * axis_sum, 1e-6);
  EXPECT_LT(centre.value, 0.98);
  // exactly no gradient, rather than one of rounding errors
  EXPECT_EQ(centre.gradient, Vector<Patient>());
  EXPECT_EQ(sphere.sample_literal(grid.X_PatientVoxel() * Point<Voxel>(8.2, 8.4, 7.7)).gradient,
            Vector<Patient>());
  EXPECT_EQ(sphere.sample(grid.X_PatientVoxel() * Point<Voxel>(8.2, 8.4, 7.7)).gradient, Vector<Patient>());
}

TEST(GaussianSphere, JumpsOnlyWhereTheWindowMoves) {
  // along i across a flat wall of all voxels beyond i = 8, at sigma 1
  const GridGeometry grid = test::make_grid({20, 12, 12}, 0);
  Volume<LabelId> wall(grid);
  for (int k = 0; k < 12; ++k) {
    for (int j = 0; j < 12; ++j) {
      for (int i = 8; i < 20; ++i) wall.at(i, j, k) = 1;
    }
  }
  const GaussianSphere sphere = gaussian_sphere_of({label_bricks(wall), {1}}, 1);
  for (const bool literal : {false, true}) {
    const auto value = [&](double i) {
      const Point<Patient> p = grid.X_PatientVoxel() * Point<Voxel>(i, 6, 6);
      return literal ? sphere.sample_literal(p).value : sphere.sample(p).value;
    };
    const double tiny = 1e-9;
    for (const double half : {6.5, 7.5, 8.5, 9.5}) {
      // the window gains the plane 2.5 voxels ahead and loses the one behind; only one of them is full
      EXPECT_NEAR(value(half + tiny) - value(half - tiny), plane_weight(1), 2e-3) << half;
      const double between = half + 0.5;
      EXPECT_LT(std::abs(value(between + tiny) - value(between - tiny)), 1e-6) << between;
    }
  }
}

TEST(GaussianSphere, ForceIsChoppyAlongAPathExactlyAtHalfVoxels) {
  SCOPED_TRACE("seed " + std::to_string(kGaussianSeed));
  std::mt19937 random(kGaussianSeed);
  GridGeometry grid = test::make_grid({80, 80, 60}, 0);
  grid.spacing_mm = {0.625, 0.625, 0.9};
  for (const double sigma : {1.0, 2.0}) {
    const GaussianSphere sphere =
        gaussian_sphere_of({internal::ball_labels(grid, grid.centre(), 18), {1}}, sigma);
    const auto window = [&](const Point<Patient>& p) {
      return ((sphere.voxels().X_VoxelPatient() * p).eigen().array() + 0.5).floor().matrix().eval();
    };
    double largest_jump = 0, largest_between = 0;
    for (int n = 0; n < 4; ++n) {
      const auto path = internal::winding_path(grid.centre(), 18, 0.01, 3000, random);
      const auto change = internal::choppiness(sphere, path).change_percent;
      for (std::size_t step = 0; step < change.size(); ++step) {
        double& largest = window(path[step]) != window(path[step + 1]) ? largest_jump : largest_between;
        largest = std::max(largest, change[step]);
      }
    }
    std::cout << "sigma " << sigma << ": jumps of up to " << largest_jump
              << " % of full force, between them up to " << largest_between << " %\n";
    // where the ball covers a large part of the plane
    EXPECT_GT(largest_jump, 50 * plane_weight(sigma));
    EXPECT_GT(largest_jump, 3 * largest_between);
  }
}

TEST(GaussianSphere, IsZeroInFreeSpaceAndAtNonFinitePositions) {
  const GridGeometry grid = test::make_grid({6, 5, 4}, 2);
  const GaussianSphere sphere = gaussian_sphere_of({label_bricks(Volume<LabelId>(grid, LabelId{7})), {7}}, 1);
  auto points = test::invalid_points(grid);
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(-4.1, 2, 2));
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(3, 2, 7.6));
  for (const auto& p : points) {
    for (const FieldSample& sample : {sphere.sample(p), sphere.sample_literal(p)}) {
      EXPECT_EQ(sample.value, 0);
      EXPECT_EQ(sample.gradient, Vector<Patient>());
    }
  }
}

TEST(GaussianSphere, RejectsASigmaOutOfRange) {
  const LabelVoxels voxels(label_bricks(Volume<LabelId>(test::make_grid({4, 4, 4}, 0))), {1});
  for (const double sigma : {0.0, -1.0, 0.49, 2.01, std::numeric_limits<double>::quiet_NaN()}) {
    const auto sphere = GaussianSphere::make(voxels, sigma);
    ASSERT_FALSE(sphere.ok()) << sigma;
    EXPECT_EQ(sphere.error().kind, ErrorKind::kBadInput);
  }
}

}  // namespace
}  // namespace palpate
