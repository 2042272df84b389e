#include <gtest/gtest.h>

#include <iostream>

#include "sampling/label_sphere_test_support.h"

namespace palpate {
namespace {

using test::make_grid;

constexpr unsigned kSmoothSeed = 1234;

SmoothSphere smooth_sphere_of(const LabelVoxels& voxels, double sigma_mm) {
  return SmoothSphere::make(voxels, sigma_mm).value();
}

TEST(SmoothSphere, VectorFormEqualsTheLiteralForm) {
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  for (const auto& dims : {std::array{19, 9, 8}, std::array{3, 4, 2}, std::array{1, 1, 1}}) {
    for (int kind = 0; kind < 4; ++kind) {
      const auto labels = internal::random_labels(test::make_grid(dims, kind), random);
      for (const double sigma : {0.05, 0.4, 0.8, 1.6}) {
        const auto points = internal::random_points(labels->geometry(), 6, 60, random);
        for (const auto& voxels : {LabelVoxels(labels, {1, 2, 3}), LabelVoxels(labels, {1, 5, 40000}),
                                   LabelVoxels::mask(*labels, {4}), LabelVoxels(labels, {})}) {
          const SmoothSphere sphere = smooth_sphere_of(voxels, sigma);
          for (const auto& p : points) {
            const FieldSample sample = sphere.sample(p), literal = sphere.sample_literal(p);
            ASSERT_NEAR(sample.value, literal.value, 1e-5) << sigma << " at " << p.eigen().transpose();
            ASSERT_LT((sample.gradient - literal.gradient).norm() * labels->geometry().min_spacing_mm(), 1e-5)
                << sigma << " at " << p.eigen().transpose();
          }
        }
      }
    }
  }
}

TEST(SmoothSphere, LargeKernelEqualsTheLiteralForm) {
  std::mt19937 random(kSmoothSeed);
  GridGeometry grid = test::make_grid({90, 12, 9}, 0);
  grid.spacing_mm = {0.1, 0.9, 1.3};
  const auto labels = internal::random_labels(grid, random);
  const SmoothSphere sphere = smooth_sphere_of({labels, {1, 2, 3}}, 1.2);
  EXPECT_DOUBLE_EQ(sphere.radius_voxels()[0], 36);
  for (const auto& p : internal::random_points(grid, 3, 30, random)) {
    EXPECT_NEAR(sphere.sample(p).value, sphere.sample_literal(p).value, 1e-5);
    EXPECT_LT((sphere.sample(p).gradient - sphere.sample_literal(p).gradient).norm(), 1e-5);
  }
}

TEST(SmoothSphere, GradientIsTheDerivativePerMillimetreInThePatientFrame) {
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = test::make_grid({14, 9, 8}, kind);
    const SmoothSphere sphere = smooth_sphere_of({internal::random_labels(grid, random), {1, 2, 3}}, 0.7);
    for (const auto& p : internal::random_points(grid, 1, 60, random)) {
      const Vector<Patient> gradient = sphere.sample(p).gradient;
      const double h = 1e-4;
      for (int axis = 0; axis < 3; ++axis) {
        Point<Patient> before = p, after = p;
        before[axis] -= h;
        after[axis] += h;
        const double difference =
            (sphere.sample_literal(after).value - sphere.sample_literal(before).value) / (2 * h);
        ASSERT_NEAR(gradient[axis], difference, 1e-5);
      }
    }
  }
}

TEST(SmoothSphere, IsExactlyFlatWithinUniformVoxels) {
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  for (int kind = 0; kind < 4; ++kind) {
    const GridGeometry grid = test::make_grid({40, 24, 20}, kind);
    const auto full = label_bricks(Volume<LabelId>(grid, LabelId{3}));
    const SmoothSphere inside = smooth_sphere_of({full, {3}}, 0.8);
    const SmoothSphere outside = smooth_sphere_of({full, {4}}, 0.8);
    for (int n = 0; n < 100; ++n) {
      Point<Voxel> x;
      for (int axis = 0; axis < 3; ++axis) {
        const double reach = inside.radius_voxels()[axis];
        x[axis] = std::uniform_real_distribution<double>(reach, grid.dims[axis] - 1 - reach)(random);
      }
      const Point<Patient> p = grid.X_PatientVoxel() * x;
      EXPECT_EQ(inside.sample(p).value, 1);
      EXPECT_EQ(inside.sample(p).gradient, Vector<Patient>());
      EXPECT_EQ(outside.sample(p).value, 0);
      EXPECT_EQ(outside.sample(p).gradient, Vector<Patient>());
    }
  }
}

TEST(SmoothSphere, WeightsSumToOneEverywhereTheBorderIncluded) {
  // the same labels inside a larger volume of free space: the border makes no difference
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  const GridGeometry small_grid = test::make_grid({9, 8, 7}, 3);
  const auto labels = internal::random_labels(small_grid, random);
  GridGeometry grid = small_grid;
  const int margin = 12;
  for (int& n : grid.dims) n += 2 * margin;
  grid.origin = small_grid.X_PatientVoxel() * Point<Voxel>(-margin, -margin, -margin);
  Volume<LabelId> surrounded(grid);
  for (int k = 0; k < 7; ++k) {
    for (int j = 0; j < 8; ++j) {
      for (int i = 0; i < 9; ++i) surrounded.at(i + margin, j + margin, k + margin) = labels->at(i, j, k);
    }
  }
  // the values for a label set, for the other labels and for free space add up to 1
  Volume<LabelId> free_space = surrounded;
  for (LabelId& voxel : free_space.voxels()) voxel = voxel == 0 ? 1 : 0;

  const LabelSet some{1, 2, 40000};
  LabelSet others = LabelSet::all();
  for (const int id : {1, 2, 40000}) others.erase(static_cast<LabelId>(id));
  for (const double sigma : {0.1, 0.6}) {
    const SmoothSphere sphere = smooth_sphere_of({labels, some}, sigma),
                       of_others = smooth_sphere_of({labels, others}, sigma);
    const SmoothSphere with_margin = smooth_sphere_of({label_bricks(surrounded), some}, sigma),
                       of_free = smooth_sphere_of({label_bricks(free_space), {1}}, sigma);
    for (const auto& p : internal::random_points(small_grid, 2, 200, random)) {
      EXPECT_NEAR(sphere.sample(p).value, with_margin.sample(p).value, 1e-6);
      EXPECT_NEAR(sphere.sample(p).value + of_others.sample(p).value + of_free.sample(p).value, 1, 1e-6);
      const Vector<Patient> gradients =
          sphere.sample(p).gradient + of_others.sample(p).gradient + of_free.sample(p).gradient;
      EXPECT_LT(gradients.norm(), 1e-5);
    }
  }
}

TEST(SmoothSphere, FlatWallHasTheDocumentedSlope) {
  // a wall across each axis in turn; its surface is half a voxel before its first centre
  for (int axis = 0; axis < 3; ++axis) {
    GridGeometry grid = test::make_grid({40, 40, 40}, 0);
    grid.spacing_mm = {0.4, 0.625, 0.9};
    Volume<LabelId> wall(grid);
    for (int k = 0; k < 40; ++k) {
      for (int j = 0; j < 40; ++j) {
        for (int i = 0; i < 40; ++i) wall.at(i, j, k) = std::array{i, j, k}[axis] >= 20 ? 1 : 0;
      }
    }
    const double sigma = 1.5;
    const SmoothSphere sphere = smooth_sphere_of({label_bricks(wall), {1}}, sigma);
    double max_gradient = 0;
    for (double at = 19; at < 20; at += 0.01) {
      Point<Voxel> x(20, 20, 20);
      x[axis] = at;
      const FieldSample sample = sphere.sample(grid.X_PatientVoxel() * x);
      max_gradient = std::max(max_gradient, sample.gradient[axis]);
      EXPECT_NEAR(sample.gradient.normalized()[axis], 1, 1e-9);
    }
    EXPECT_NEAR(max_gradient, 35 / (96 * sigma), 0.01 / sigma);
    EXPECT_LT(max_gradient, 1 / (sigma * std::sqrt(2 * std::numbers::pi)));
    Point<Voxel> surface(20, 20, 20);
    surface[axis] = 19.5;
    EXPECT_NEAR(sphere.sample(grid.X_PatientVoxel() * surface).value, 0.5, 1e-6);
  }
}

TEST(SmoothSphere, IsContinuousWhereTheWindowMoves) {
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  const GridGeometry grid = test::make_grid({20, 20, 20}, 0);
  const SmoothSphere sphere = smooth_sphere_of({internal::random_labels(grid, random), {1, 2, 3}}, 1.1);
  const double tiny = 1e-7;
  for (int start = 5; start < 12; ++start) {
    // the window gains or loses a voxel where its end coincides with a centre
    const double i = start + sphere.radius_voxels()[0];
    const Point<Patient> before = grid.X_PatientVoxel() * Point<Voxel>(i - tiny, 9.3, 9.8);
    const Point<Patient> after = grid.X_PatientVoxel() * Point<Voxel>(i + tiny, 9.3, 9.8);
    EXPECT_NEAR(sphere.sample(before).value, sphere.sample(after).value, 1e-6);
    EXPECT_LT((sphere.sample(before).gradient - sphere.sample(after).gradient).norm(), 1e-5);
  }
}

TEST(SmoothSphere, ForceIsSmoothAtTheRecommendedRadius) {
  SCOPED_TRACE("seed " + std::to_string(kSmoothSeed));
  std::mt19937 random(kSmoothSeed);
  GridGeometry grid = test::make_grid({90, 90, 64}, 0);
  grid.spacing_mm = {0.625, 0.625, 0.9};
  const LabelVoxels voxels(internal::ball_labels(grid, grid.centre(), 20), {1});
  const SmoothSphere smooth = smooth_sphere_of(voxels, 1.5), smallest = smooth_sphere_of(voxels, 0.05);
  internal::Choppiness all, of_smallest;
  for (const double depth : {-0.5, 0.0, 0.75, 1.5}) {
    const auto path = internal::winding_path(grid.centre(), 20 - depth, 0.01, 2500, random);
    for (const double change : internal::choppiness(smooth, path).change_percent)
      all.change_percent.push_back(change);
    for (const double change : internal::choppiness(smallest, path).change_percent) {
      of_smallest.change_percent.push_back(change);
    }
  }
  std::cout << "change of force over 0.01 mm, percent of full force, p99 (max): sigma 1.5 mm "
            << all.quantile(0.99) << " (" << all.quantile(1) << "), over 4^3 voxels "
            << of_smallest.quantile(0.99) << " (" << of_smallest.quantile(1) << ")\n";
  EXPECT_LT(all.quantile(0.99), 1);
  EXPECT_LT(all.quantile(1), 1);
  // over 4^3 voxels the force is rough, hence the minimum radius
  EXPECT_GT(of_smallest.quantile(0.99), 1);
}

TEST(SmoothSphere, IsZeroInFreeSpaceAndAtNonFinitePositions) {
  const GridGeometry grid = test::make_grid({6, 5, 4}, 2);
  const SmoothSphere sphere = smooth_sphere_of({label_bricks(Volume<LabelId>(grid, LabelId{7})), {7}}, 0.5);
  auto points = test::invalid_points(grid);
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(-sphere.radius_voxels()[0] - 0.1, 2, 2));
  points.push_back(grid.X_PatientVoxel() * Point<Voxel>(3, 2, 3.1 + sphere.radius_voxels()[2]));
  for (const auto& p : points) {
    for (const FieldSample& sample : {sphere.sample(p), sphere.sample_literal(p)}) {
      EXPECT_EQ(sample.value, 0);
      EXPECT_EQ(sample.gradient, Vector<Patient>());
    }
  }
}

TEST(SmoothSphere, RadiusIsInMillimetresAndNeverLessThanTwoVoxels) {
  GridGeometry grid = test::make_grid({4, 4, 4}, 0);
  grid.spacing_mm = {0.5, 1, 3};
  const LabelVoxels voxels(label_bricks(Volume<LabelId>(grid)), {1});
  EXPECT_EQ(smooth_sphere_of(voxels, 1).radius_voxels(), (std::array<double, 3>{6, 3, 2}));

  for (const double sigma :
       {0.0, -1.0, 11.0, std::numeric_limits<double>::infinity(), std::numeric_limits<double>::quiet_NaN()}) {
    const auto sphere = SmoothSphere::make(voxels, sigma);
    ASSERT_FALSE(sphere.ok()) << sigma;
    EXPECT_EQ(sphere.error().kind, ErrorKind::kBadInput);
  }
  EXPECT_TRUE(SmoothSphere::make(voxels, 10.6).ok());
}

}  // namespace
}  // namespace palpate
