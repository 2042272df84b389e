#include "palpate/contact/distances.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numeric>
#include <random>

#include "base/test_seed.h"
#include "contact/test_proxy_surfaces.h"
#include "contact/test_surface_oracle.h"

namespace palpate {
namespace {

using testing::cube_grid;
using testing::Distance;
using testing::make_contact_surface;
using testing::SurfaceOracle;

constexpr double kTolerance_mm = 0.05;

std::shared_ptr<const Surface> surface_of(const GridGeometry& grid, const Distance& distance_mm) {
  return make_contact_surface(grid, distance_mm, 4).surface;
}

/// The grids of the contact tests, axis-aligned and rotated.
std::vector<GridGeometry> distance_grids(double half_extent_mm) {
  const Eigen::Matrix3d turned =
      (Eigen::AngleAxisd(0.4, Eigen::Vector3d(1, 2, -1).normalized())).toRotationMatrix();
  std::vector<GridGeometry> grids;
  for (const Eigen::Vector3d& spacing_mm :
       {Eigen::Vector3d(0.277, 0.277, 1.0), Eigen::Vector3d(0.36, 0.36, 0.7),
        Eigen::Vector3d(0.625, 0.625, 0.9), Eigen::Vector3d(1.5, 1.5, 1.5)}) {
    grids.push_back(cube_grid(half_extent_mm, spacing_mm));
    grids.push_back(cube_grid(half_extent_mm, spacing_mm, turned));
  }
  return grids;
}

double box_mm(const Eigen::Vector3d& p, const Eigen::Vector3d& half_mm) {
  const Eigen::Vector3d over = p.cwiseAbs() - half_mm;
  return over.cwiseMax(0).norm() + std::min(0.0, over.maxCoeff());
}

struct Shape {
  const char* name;
  Distance distance_mm;
};
std::vector<Shape> distance_shapes(std::mt19937& random) {
  // overlapping balls with creases between them
  std::vector<std::pair<Eigen::Vector3d, double>> balls;
  std::uniform_real_distribution<double> coordinate(-4, 4), radius(1, 2.5);
  for (int n = 0; n < 9; ++n) {
    const double z = coordinate(random), y = coordinate(random), x = coordinate(random);
    balls.push_back({{x, y, z}, radius(random)});
  }
  return {
      {"sphere", [](const Eigen::Vector3d& p) { return (p - Eigen::Vector3d(0.1, -0.2, 0.15)).norm() - 5; }},
      {"plate",
       [](const Eigen::Vector3d& p) {
         return box_mm(p, {6.03, 5.11, 0.83});
       }},
      {"edge",
       [](const Eigen::Vector3d& p) {
         // an edge of 90 degrees whose planes are oblique to the axes
         const double a = p.dot(Eigen::Vector3d(0.6, 0.48, 0.64)),
                      b = p.dot(Eigen::Vector3d(-0.8, 0.36, 0.48));
         return std::max({std::min(0.0, std::max(a, b)) + std::hypot(std::max(a, 0.0), std::max(b, 0.0)),
                          box_mm(p, {7.07, 6.91, 6.83})});
       }},
      {"balls", [balls](const Eigen::Vector3d& p) {
         double smallest = 1e3;
         for (const auto& [centre, r] : balls) smallest = std::min(smallest, (p - centre).norm() - r);
         return smallest;
       }}};
}

TEST(Distances, EqualTheOracleOnEveryGrid) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> far(-25, 25), near(-1.5, 1.5);
  std::normal_distribution<double> around(0, 3);
  double worst_mm = 0;
  for (const GridGeometry& grid : distance_grids(9))
    for (const Shape& shape : distance_shapes(random)) {
      SCOPED_TRACE(std::string(shape.name) + ", voxels of " + std::to_string(grid.spacing_mm.x()) + " x " +
                   std::to_string(grid.spacing_mm.z()));
      const auto surface = surface_of(grid, shape.distance_mm);
      const SurfaceTree tree(surface);
      const SurfaceOracle oracle(*surface);
      ASSERT_GT(tree.pieces(), 0u);
      for (int n = 0; n < 30; ++n) {
        // far away, uniformly around, and close to the surface
        Eigen::Vector3d x;
        std::uniform_int_distribution<std::size_t> any(0, oracle.points().size() - 1);
        const Eigen::Vector3d on = oracle.points()[any(random)];
        for (int axis = 0; axis < 3; ++axis)
          x[axis] = n % 3 == 0 ? far(random) : n % 3 == 1 ? around(random) : on[axis] + near(random);
        const auto found = tree.nearest(Point<Patient>(x));
        ASSERT_TRUE(found.has_value());
        const double truth_mm = oracle.distance_mm(Point<Patient>(x));
        worst_mm = std::max(worst_mm, std::abs(std::abs(found->distance_mm) - truth_mm));
        EXPECT_NEAR(std::abs(found->distance_mm), truth_mm, kTolerance_mm)
            << x.transpose() << ", found at " << found->position.eigen().transpose();
        EXPECT_EQ(found->distance_mm < 0, surface->distance_mm(Point<Patient>(x)) < 0) << x.transpose();
        EXPECT_NEAR((found->position - Point<Patient>(x)).norm(), std::abs(found->distance_mm), 1e-9);
        EXPECT_NEAR(surface->distance_mm(found->position), 0, 0.002)
            << "the place lies on the surface; " << x.transpose() << ", "
            << found->position.eigen().transpose();
      }
    }
  RecordProperty("worst_um", static_cast<int>(std::lround(1e3 * worst_mm)));
}

TEST(Distances, OnTheMedialAxisUseTheNearerSide) {
  // where an interpolated distance field is clamped
  const SurfaceTree plate(surface_of(cube_grid(9, {0.625, 0.625, 0.9}), [](const Eigen::Vector3d& p) {
    return box_mm(p, {6, 5, 1.35});
  }));
  for (double x = -3; x <= 3; x += 0.17)
    EXPECT_NEAR(plate.nearest({x, 0.3 * x, 0.01})->distance_mm, -1.34, kTolerance_mm) << x;
  // at the centre of a ball all surface points are equally near
  const SurfaceTree ball(
      surface_of(cube_grid(14, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.norm() - 12; }));
  EXPECT_NEAR(ball.nearest({0, 0, 0})->distance_mm, -12, kTolerance_mm);
}

TEST(Distances, EndAtTheRequestedReach) {
  const SurfaceTree ball(
      surface_of(cube_grid(9, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.norm() - 5; }));
  EXPECT_FALSE(ball.nearest({10, 0, 0}, 4.9).has_value());
  EXPECT_NEAR(ball.nearest({10, 0, 0}, 5.1)->distance_mm, 5, kTolerance_mm);
  EXPECT_NEAR(ball.nearest({1, 0, 0}, 0.5)->distance_mm, -4, kTolerance_mm) << "inside there is no end";
  const double nan = std::numeric_limits<double>::quiet_NaN(), inf = std::numeric_limits<double>::infinity();
  for (const double bad : {nan, inf, -inf}) EXPECT_FALSE(ball.nearest({bad, 0, 0}).has_value());
  const SurfaceTree nothing(surface_of(cube_grid(3, {1, 1, 1}), [](const Eigen::Vector3d&) { return 4; }));
  EXPECT_EQ(nothing.pieces(), 0u);
  EXPECT_FALSE(nothing.nearest({0, 0, 0}).has_value());
}

TEST(Distances, GrowFastestAlongOutward) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const SurfaceTree ball(
      surface_of(cube_grid(9, {0.36, 0.36, 0.7}), [](const Eigen::Vector3d& p) { return p.norm() - 5; }));
  std::uniform_real_distribution<double> radius(4, 9);
  double worst = 1;
  for (int n = 0; n < 300; ++n) {
    const Vector<Patient> out = testing::random_direction(random);
    const Point<Patient> x =
        Point<Patient>() + out * (n % 3 == 0 ? 5 + 0.01 * (n % 20 - 10) : radius(random));
    const Vector<Patient> found = ball.outward(x, *ball.nearest(x));
    EXPECT_NEAR(found.norm(), 1, 1e-9);
    worst = std::min(worst, found.dot(out));
  }
  EXPECT_GT(worst, std::cos(0.12)) << "of a surface of voxels, radians";
}

TEST(Distances, UpdatedVersionEqualsARebuiltTree) {
  const GridGeometry grid = cube_grid(14, {0.5, 0.5, 0.5});
  const auto ball = [](const Eigen::Vector3d& p) { return p.norm() - 9; };
  const auto before = surface_of(grid, ball);
  // a dent in some of its bricks
  const SignedField dented = testing::sampled_distance(
      grid,
      [&](const Eigen::Vector3d& p) { return std::max(ball(p), 3 - (p - Eigen::Vector3d(9, 0, 0)).norm()); },
      4);
  const auto& dims = grid.dims;
  PatchOf<std::int16_t> patch{{{dims[0] - 20, 10, 10}, {20, dims[1] - 20, dims[2] - 20}}, {}};
  for (int k = 0; k < patch.box.size[2]; ++k)
    for (int j = 0; j < patch.box.size[1]; ++j)
      for (int i = 0; i < patch.box.size[0]; ++i)
        patch.values.push_back(
            dented.bricks().at(patch.box.first[0] + i, patch.box.first[1] + j, patch.box.first[2] + k));
  const auto after = std::make_shared<const Surface>(before->with(patch, {}, 1));
  ASSERT_NE(after->content_hash(), before->content_hash());
  const SurfaceTree old(before), followed = old.with(after), anew(after), back = followed.with(before);
  EXPECT_EQ(followed.pieces(), anew.pieces());
  EXPECT_NEAR(followed.nearest({9, 0, 0})->distance_mm, 3, 0.1);
  EXPECT_NEAR(old.nearest({9, 0, 0})->distance_mm, 0, kTolerance_mm);
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> any(-14, 14);
  for (int n = 0; n < 300; ++n) {
    const double z = any(random), y = any(random), x = any(random);
    const Point<Patient> p(x, y, z);
    EXPECT_EQ(followed.nearest(p)->distance_mm, anew.nearest(p)->distance_mm);
    EXPECT_EQ(back.nearest(p)->distance_mm, old.nearest(p)->distance_mm);
  }
}

TEST(Distances, ToolDistanceIsThatOfItsNearestPart) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> part(-8, 8), length(-12, 12), radius(0.2, 1.5), off(-2, 2);
  const auto surface = surface_of(cube_grid(9, {0.625, 0.625, 0.9}), [](const Eigen::Vector3d& p) {
    return box_mm(p, {6, 5, 0.8});
  });
  const SurfaceTree tree(surface);
  for (int n = 0; n < 120; ++n) {
    const auto vector = [&](auto& of) {
      const double z = of(random), y = of(random), x = of(random);
      return Vector<Patient>(x, y, z);
    };
    const Vector<Patient> from = vector(off), along = vector(length);
    const double first_mm = radius(random), end_mm = radius(random);
    const std::vector<ToolPart> tool{{{}, 0.5}, {from, first_mm, along, end_mm - first_mm}};
    const Point<Patient> tip = Point<Patient>() + vector(part);
    const auto found = distance_of_tool(tree, tool, tip, 40);
    ASSERT_TRUE(found.has_value());
    double truth_mm = tree.nearest(tip)->distance_mm - 0.5;
    for (int p = 0; p <= 400; ++p) {
      const double at = p / 400.0;
      truth_mm = std::min(
          truth_mm, tree.nearest(tip + from + along * at)->distance_mm - first_mm - (end_mm - first_mm) * at);
    }
    EXPECT_NEAR(found->distance_mm, truth_mm, kTolerance_mm) << n;
    EXPECT_NEAR(found->near.distance_mm - found->radius_mm, found->distance_mm, 1e-9);
  }
}

// small balls on a circle, each a structure
DistanceTrees many_balls(int count, double reach_mm) {
  std::vector<TrackedStructure> structures;
  for (int n = 0; n < count; ++n) {
    const double turn = 2 * std::acos(-1.0) * n / count;
    const Eigen::Vector3d centre(30 * std::cos(turn), 30 * std::sin(turn), 0);
    GridGeometry grid = cube_grid(4, {0.5, 0.5, 0.5});
    grid.origin += Vector<Patient>(centre);
    structures.push_back({static_cast<LabelId>(n + 1),
                          std::make_shared<const SurfaceTree>(surface_of(
                              grid, [&](const Eigen::Vector3d& p) { return (p - centre).norm() - 2; })),
                          n % 10 != 3});
  }
  return {std::move(structures), reach_mm};
}

TEST(Distances, ReportedDistancesAreTheNearestInOrder) {
  const DistanceTrees distances = many_balls(60, 20);
  const std::vector<ToolPart> point{{}};
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> any(-60, 60), up(-10, 10);
  int full = 0, none = 0;
  for (int n = 0; n < 400; ++n) {
    const double z = up(random), y = any(random), x = any(random);
    const Point<Patient> tip(x, y, z);
    // reference: all structures one by one
    std::vector<std::pair<double, LabelId>> all;
    for (const TrackedStructure& structure : distances.structures())
      if (const auto near = structure.tree->nearest(tip, 20); near && structure.reported)
        all.push_back({near->distance_mm, structure.label});
    std::sort(all.begin(), all.end());
    const auto reported = nearest_structures(distances, point, tip);
    for (std::size_t index = 0; index < reported.size(); ++index) {
      if (index >= all.size()) {
        EXPECT_EQ(reported[index].label, 0);
        continue;
      }
      // the search limit affects the result by at most the slack
      EXPECT_NEAR(reported[index].distance_mm, all[index].first, 2 * SurfaceTree::kSlack_mm);
      const std::size_t before = index > 0 ? index - 1 : 0;
      EXPECT_GE(reported[index].distance_mm, reported[before].distance_mm);
    }
    full += reported.back().label != 0;
    none += reported.front().label == 0;
  }
  EXPECT_GT(full, 0);
  EXPECT_GT(none, 10);
}

}  // namespace
}  // namespace palpate
