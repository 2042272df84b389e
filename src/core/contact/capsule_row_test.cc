#include "contact/capsule_row.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "contact/test_proxy_surfaces.h"

/// Rows of spheres represent capsules within tolerance, and are searched without evaluating every sphere.
namespace palpate {
namespace {

using testing::cube_grid;
using testing::make_contact_surface;
using testing::random_direction;

constexpr unsigned kRowSeed = 83;

TEST(CapsuleRow, OutlineApproximatesTheCapsuleWithinTolerance) {
  EXPECT_EQ(row_steps({{}, 1}), 0);
  for (const double radius_mm : {0.3, 0.5, 1.0, 1.5, 3.0, 10.0})
    for (const double length_mm : {0.1, 1.0, 7.3, 60.0, 600.0}) {
      const int steps = row_steps({{}, radius_mm, {0, 0, length_mm}});
      ASSERT_GE(steps, 1);
      const double half_mm = 0.5 * length_mm / steps;
      EXPECT_LE(radius_mm - std::sqrt(radius_mm * radius_mm - half_mm * half_mm),
                kProxySettings.max_row_gap_mm);
    }
  // thin capsules have the minimum spacing
  for (const double radius_mm : {0.0, 0.1}) EXPECT_EQ(row_steps({{}, radius_mm, {10, 0, 0}}), 67);
}

// a ball, and a plate along which a row may lie, on rotated voxels
std::vector<ContactSurface> ball_and_plate(std::mt19937& random) {
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(1, random_direction(random).eigen()).toRotationMatrix();
  return {make_contact_surface(
              cube_grid(14, {0.5, 0.5, 0.9}, turn), [](const Eigen::Vector3d& p) { return p.norm() - 6; }, 4),
          make_contact_surface(
              cube_grid(14, {0.5, 0.5, 0.9}, turn), [](const Eigen::Vector3d& p) { return p.z(); }, 4)};
}

TEST(CapsuleRow, NearestSphereEqualsExhaustiveSearch) {
  SCOPED_TRACE("seed " + std::to_string(kRowSeed));
  std::mt19937 random(kRowSeed);
  std::uniform_real_distribution<double> unit(0, 1), about(-4, 4);
  const auto surfaces = ball_and_plate(random);
  int queries = 0, all = 0, bounds = 0;
  // inside the volume; beyond it the plate's distance drops to the value outside
  for (int n = 0; n < 20'000; ++n) {
    const Surface& surface = *surfaces[static_cast<std::size_t>(n % 2)].surface;
    const double x = about(random), y = about(random), z = about(random);
    const Point<Patient> centre(x, y, z);
    // every tenth capsule is parallel to the plate
    Vector<Patient> axis_mm = random_direction(random) * (0.1 + 7 * unit(random));
    if (n % 20 == 1) axis_mm = {axis_mm.x(), axis_mm.y(), 0};
    ToolPart shape{{}, 0.01 + 2 * unit(random), axis_mm};
    // every third capsule is tapered
    if (n % 3 == 2) shape.radius_change_mm = 2 * unit(random) - shape.radius_mm;
    const int steps = row_steps(shape);
    const double cutoff_mm = n % 3 == 0 ? std::numeric_limits<double>::infinity() : 3 * unit(random);
    const int begin = static_cast<int>(unit(random) * steps);

    double min_mm = std::numeric_limits<double>::infinity();
    const auto at_step = [&](int step) {
      const double part = static_cast<double>(step) / steps;
      return surface.distance_mm(centre + axis_mm * part) - shape.radius_change_mm * part;
    };
    for (int step = 0; step <= steps; ++step) min_mm = std::min(min_mm, at_step(step));
    const NearestInRow nearest = nearest_in_row(surface, centre, shape, steps, begin, cutoff_mm, queries);
    all += steps + 1;
    if (nearest.distance_mm <= cutoff_mm) {
      ASSERT_EQ(nearest.distance_mm, min_mm);
      ASSERT_EQ(at_step(nearest.step), min_mm);
    } else {
      ASSERT_GT(min_mm, cutoff_mm);
      ASSERT_LE(nearest.distance_mm, min_mm + 1e-12);
      ++bounds;
    }
  }
  EXPECT_GT(bounds, 1000);
  EXPECT_LT(queries, all * 3 / 4) << "of short rows near the surface";
}

TEST(CapsuleRow, ContactCentreIsTheCentreOfTheSupportedSegment) {
  std::mt19937 random(kRowSeed);
  int queries = 0;
  const auto surfaces = ball_and_plate(random);
  // the whole capsule lies on the plate; then only its end touches
  const Point<Patient> on_plate(-5, 1, 1);
  EXPECT_NEAR(middle_of_touching(*surfaces[1].surface, on_plate, {{}, 1, {10, 0, 0}}, 40, 3, 0.02, queries),
              0.5, 0.02);
  EXPECT_NEAR(middle_of_touching(*surfaces[1].surface, on_plate, {{}, 1, {8, 0, 6}}, 40, 0, 0.02, queries), 0,
              1e-9);
  // nearest to the ball at a third of the axis
  EXPECT_NEAR(middle_of_touching(*surfaces[0].surface, {-3, 0, 7}, {{}, 1, {9, 0, 0}}, 30, 10, 0.02, queries),
              1.0 / 3, 0.03);
  // a cone with its side along the plate and its axis inclined to it
  const ToolPart cone{{}, 1, Vector<Patient>(std::sqrt(99.0), 0, 1), 1};
  EXPECT_NEAR(middle_of_touching(*surfaces[1].surface, on_plate, cone, 40, 3, 0.02, queries), 0.5, 0.02);
}

}  // namespace
}  // namespace palpate
