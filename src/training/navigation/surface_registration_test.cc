#include "palpate/navigation/surface_registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "navigation/test_poses.h"

namespace palpate {
namespace {

using ::testing::AnyOf;
using ::testing::HasSubstr;
using Distance = std::function<double(const Eigen::Vector3d&)>;

double capsule(const Eigen::Vector3d& x, const Eigen::Vector3d& from, const Eigen::Vector3d& to,
               double radius) {
  const Eigen::Vector3d displacement = to - from;
  const double t = std::clamp((x - from).dot(displacement) / displacement.squaredNorm(), 0.0, 1.0);
  return (x - from - t * displacement).norm() - radius;
}
// intersecting rods of different sizes: without any symmetry, including mirror symmetry
double rods(const Eigen::Vector3d& x) {
  return std::min({capsule(x, {-20, 0, 0}, {20, 4, 0}, 7), capsule(x, {20, 2, 0}, {24, 26, 4}, 6),
                   capsule(x, {-20, 0, 0}, {-24, -4, 26}, 6), capsule(x, {-24, -4, 26}, {-26, 20, 28}, 5)});
}

// as prepared surfaces: exact up to 4 mm
Surface surface_of(const Distance& distance) {
  GridGeometry grid;
  grid.dims = {90, 80, 80};
  grid.spacing_mm = {1, 1, 1};
  grid.origin = Point<Patient>(-45, -40, -40);
  const SignedSteps steps{1.0 / 2048, 0, 4 * 2048};
  Volume<std::int16_t> values(grid);
  const Transform<Patient, Voxel> X = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j)
      for (int i = 0; i < grid.dims[0]; ++i)
        values.at(i, j, k) = static_cast<std::int16_t>(
            std::lround(2048 * std::clamp(distance((X * Point<Voxel>(i, j, k)).eigen()), -4.0, 4.0)));
  const SignedField field(values, steps);
  return Surface(field, field, 1);
}

std::vector<Point<Patient>> sample_surface(const Distance& distance, std::size_t count,
                                           std::mt19937& random) {
  std::vector<Point<Patient>> positions;
  while (positions.size() < count) {
    Eigen::Vector3d x;
    for (double& each : x) each = 34 * std::uniform_real_distribution<double>(-1, 1)(random);
    for (int turn = 0; turn < 30; ++turn) {
      Eigen::Vector3d slope;
      for (int k = 0; k < 3; ++k)
        slope[k] =
            (distance(x + 1e-4 * Eigen::Vector3d::Unit(k)) - distance(x - 1e-4 * Eigen::Vector3d::Unit(k))) /
            2e-4;
      x -= distance(x) * slope;
    }
    if (std::abs(distance(x)) < 1e-6 && x.cwiseAbs().maxCoeff() < 35) positions.emplace_back(x);
  }
  return positions;
}

struct Case {
  Transform<Patient, Tracker> truth, start;
  std::vector<Point<Tracker>> touched;
};
// displaced by 10 degrees and 10 mm
Case away_from(const std::vector<Point<Patient>>& positions, double noise_mm, std::mt19937& random) {
  Case out;
  out.truth = {Rotation<Patient, Tracker>(test::any_rotation(random)),
               Vector<Patient>(100 * test::normal(random))};
  const Eigen::Matrix3d turned =
      Eigen::AngleAxisd(std::numbers::pi / 18, test::normal(random).normalized()).toRotationMatrix();
  out.start = Transform<Patient, Patient>(turned, 10 * test::normal(random).normalized()) * out.truth;
  for (const Point<Patient>& position : positions)
    out.touched.push_back(out.truth.inverse() *
                          (position + Vector<Patient>(noise_mm * test::normal(random))));
  return out;
}
double max_off_mm(const SurfaceRegistration& found, const Case& of) {
  double largest = 0;
  for (const Point<Tracker>& point : of.touched)
    largest = std::max(largest, (found.patient_from_tracker * point - of.truth * point).norm());
  return largest;
}

TEST(RegisterToSurface, ComesBackFromTenDegreesAndTenMillimetres) {
  std::mt19937 random(test::test_seed());
  const Surface surface = surface_of(rods);
  for (int turn = 0; turn < 12; ++turn) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", turn " + std::to_string(turn));
    const Case of = away_from(sample_surface(rods, 60, random), 0, random);
    const auto found = register_to_surface(surface, of.touched, of.start);
    ASSERT_TRUE(found) << found.error().message();
    EXPECT_LT(max_off_mm(*found, of), 0.1);
    EXPECT_LT(found->rms_mm, 0.05);
  }
}

TEST(RegisterToSurface, HandsThatShakeAndSlipAndABallThatTouches) {
  std::mt19937 random(test::test_seed());
  const Surface surface = surface_of(rods);
  for (int turn = 0; turn < 6; ++turn) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", turn " + std::to_string(turn));
    // centre of a ball of 1.5 mm
    auto points = sample_surface([](const Eigen::Vector3d& x) { return rods(x) - 1.5; }, 120, random);
    Case of = away_from(points, 0.15, random);
    std::vector<std::size_t> slipped;
    for (std::size_t n = 0; n < of.touched.size(); n += 12) {
      of.touched[n] += Vector<Tracker>(2.5, 2.5, 2.5);
      if (std::abs(rods((of.truth * of.touched[n]).eigen()) - 1.5) > 1) slipped.push_back(n);
    }
    const auto found = register_to_surface(surface, of.touched, of.start, {.tip_radius_mm = 1.5});
    ASSERT_TRUE(found) << found.error().message();
    EXPECT_LT(max_off_mm(*found, of), 0.5);
    for (const std::size_t n : slipped) EXPECT_TRUE(found->is_trimmed[n]) << n;
  }
}

TEST(RegisterToSurface, RejectsUndeterminedOrPoorFits) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  const auto refused = [&](const Distance& of_surface, const std::vector<Point<Patient>>& positions) {
    const Case of = away_from(positions, 0, random);
    const auto found = register_to_surface(surface_of(of_surface), of.touched, of.start);
    return found ? std::string("accepted") : found.error().message();
  };
  const Distance ball = [](const Eigen::Vector3d& x) { return x.norm() - 20; };
  EXPECT_THAT(refused(ball, sample_surface(ball, 60, random)),
              HasSubstr("do not constrain the rotation about"));
  const Distance rod = [](const Eigen::Vector3d& x) { return capsule(x, {-100, 0, 0}, {100, 0, 0}, 9); };
  EXPECT_THAT(refused(rod, sample_surface(rod, 60, random)),
              HasSubstr("do not constrain the translation along"));
  auto mirrored = sample_surface(rods, 60, random);
  for (auto& point : mirrored) point = {-point.x(), point.y(), point.z()};
  EXPECT_THAT(refused(rods, mirrored),
              AnyOf(HasSubstr("do not fit the surface"), HasSubstr("farther than 5 mm")));
  mirrored.resize(11);
  EXPECT_THAT(refused(rods, mirrored), HasSubstr("12 points at least, but there are 11"));
  EXPECT_THAT(refused([](const Eigen::Vector3d&) { return 4.0; }, sample_surface(rods, 20, random)),
              HasSubstr("no surface"));
}

}  // namespace
}  // namespace palpate
