#include "palpate/navigation/registration.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <numbers>
#include <random>

#include "base/test_seed.h"
#include "navigation/distributions.h"
#include "navigation/test_poses.h"

namespace palpate {
namespace {

using ::testing::HasSubstr;

std::vector<Eigen::Vector3d> cube_corners() {
  std::vector<Eigen::Vector3d> corners;
  for (int n = 0; n < 8; ++n) corners.emplace_back(n & 1 ? 50 : -50, n & 2 ? 50 : -50, n & 4 ? 50 : -50);
  return corners;
}

std::vector<PointPair> pairs_of(const std::vector<Eigen::Vector3d>& scan,
                                const Transform<Patient, Tracker>& truth, double fle_mm = 1) {
  std::vector<PointPair> pairs;
  for (const Eigen::Vector3d& p : scan)
    pairs.push_back({"P" + std::to_string(pairs.size() + 1), Point<Patient>(p),
                     truth.inverse() * Point<Patient>(p), fle_mm});
  return pairs;
}

Transform<Patient, Tracker> some_pose(std::mt19937& random) {
  return {Rotation<Patient, Tracker>(test::any_rotation(random)),
          Vector<Patient>(100 * test::normal(random))};
}

TEST(ChiSquared, QuantilesOfTables) {
  // Abramowitz and Stegun, table 26.8
  EXPECT_NEAR(chi_squared_quantile(1, 0.95), 3.84146, 1e-5);
  EXPECT_NEAR(chi_squared_quantile(3, 0.05), 0.351846, 1e-6);
  EXPECT_NEAR(chi_squared_quantile(10, 0.975), 20.4831, 1e-4);
  EXPECT_NEAR(chi_squared_quantile(100, 0.5), 99.3341, 1e-4);
  EXPECT_NEAR(chi_squared_quantile(2, 0.5), 2 * std::numbers::ln2, 1e-10);
}

TEST(RegisterPoints, RecoversTheTransform) {
  std::mt19937 random(test::test_seed());
  for (int turn = 0; turn < 200; ++turn) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", turn " + std::to_string(turn));
    std::vector<Eigen::Vector3d> scan;
    for (unsigned n = 0; n < 3 + random() % 8; ++n) scan.emplace_back(60 * test::normal(random));
    const auto truth = some_pose(random);
    const auto found = register_points(pairs_of(scan, truth), {.min_spread_mm = 1e-3, .min_width = 1e-3});
    ASSERT_TRUE(found) << found.error().message();
    EXPECT_LT((found->patient_from_tracker.linear() - truth.linear()).norm(), 1e-8);
    EXPECT_LT((found->patient_from_tracker.translation() - truth.translation()).norm(), 1e-6);
    EXPECT_LT(found->fre_mm, 1e-9);
    EXPECT_NEAR(found->patient_from_tracker.linear().determinant(), 1, 1e-12);
  }
}

// no rigid perturbation reduces the residual: the solution is a minimum, also with weights
TEST(RegisterPoints, NothingNearbyLeavesLess) {
  std::mt19937 random(test::test_seed());
  for (int turn = 0; turn < 50; ++turn) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", turn " + std::to_string(turn));
    auto pairs = pairs_of(cube_corners(), some_pose(random));
    for (PointPair& pair : pairs) {
      pair.fle_mm = 0.2 + 3 * std::generate_canonical<double, 53>(random);
      pair.tracked += Vector<Tracker>(pair.fle_mm * test::normal(random));
    }
    const auto found = register_points(pairs);
    ASSERT_TRUE(found);
    const auto left = [&](const Transform<Patient, Tracker>& X) {
      double sum = 0;
      for (const PointPair& pair : pairs)
        sum += (X * pair.tracked - pair.in_scan).squared_norm() / (pair.fle_mm * pair.fle_mm);
      return sum;
    };
    const double smallest = left(found->patient_from_tracker);
    for (int n = 0; n < 50; ++n) {
      const Eigen::Matrix3d turned =
          Eigen::AngleAxisd(1e-3, test::normal(random).normalized()).toRotationMatrix();
      const Transform<Patient, Patient> moved(turned, 0.05 * test::normal(random));
      EXPECT_GT(left(moved * found->patient_from_tracker), smallest);
    }
  }
}

// FLE^2 = 1, eight corners of a cube: values of the formula
TEST(TargetError, OfTheCube) {
  const auto found = register_points(pairs_of(cube_corners(), {}));
  ASSERT_TRUE(found);
  EXPECT_NEAR(std::pow(error_at(rigid_error(*found, 1), {}).rms_mm, 2), 0.1250, 1e-9);
  EXPECT_NEAR(std::pow(error_at(rigid_error(*found, 1), {100, 0, 0}).rms_mm, 2), 0.2917, 5e-5);
}

// for arbitrary points: Fitzpatrick's equation, written out
TEST(TargetError, IsFitzpatricksEquation) {
  std::mt19937 random(test::test_seed());
  for (int turn = 0; turn < 100; ++turn) {
    SCOPED_TRACE("seed " + std::to_string(test::test_seed()) + ", turn " + std::to_string(turn));
    std::vector<Eigen::Vector3d> scan;
    for (unsigned n = 0; n < 4 + random() % 8; ++n) scan.emplace_back(60 * test::normal(random));
    const auto found = register_points(pairs_of(scan, {}));
    if (!found) continue;
    const Point<Patient> target(100 * test::normal(random));
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();
    for (const auto& p : scan) centre += p / static_cast<double>(scan.size());
    Eigen::Matrix3d shape = Eigen::Matrix3d::Zero();
    for (const auto& p : scan)
      shape += (p - centre) * (p - centre).transpose() / static_cast<double>(scan.size());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(shape);
    double sum = 0;
    for (int k = 0; k < 3; ++k) {
      const Eigen::Vector3d axis = axes.eigenvectors().col(k), away = target.eigen() - centre;
      sum += (away - axis.dot(away) * axis).squaredNorm() / (shape.trace() - axes.eigenvalues()[k]);
    }
    EXPECT_NEAR(error_at(rigid_error(*found, 1), target).rms_mm,
                std::sqrt((1 + sum / 3) / static_cast<double>(scan.size())), 1e-9);
  }
}

// predicted and simulated errors agree, also for the coplanar points of scikit-surgerycore's test, for which
// the formula gives 1.350
TEST(TargetError, EqualsTheSimulatedError) {
  const std::vector<Eigen::Vector3d> uneven = {
      {0, 0, 0}, {80, 5, 0}, {10, 60, 8}, {-20, 30, 40}, {15, -30, 25}};
  const Point<Patient> target(40, -60, 90);
  for (const bool weighted : {false, true}) {
    const unsigned seed = test::test_seed();
    SCOPED_TRACE("seed " + std::to_string(seed));
    std::mt19937 random(seed);
    auto pairs = pairs_of(uneven, {});
    if (weighted)
      for (std::size_t n = 0; n < pairs.size(); ++n) pairs[n].fle_mm = 0.5 + 0.5 * static_cast<double>(n);
    const auto exact = register_points(pairs);
    ASSERT_TRUE(exact);
    const ErrorSpread predicted = error_at(rigid_error(*exact, 0.5), target);
    constexpr int kRuns = 20000;
    double squares = 0, below = 0, scales = 0, within = 0, fre = 0, both = 0, tre = 0, fre_fre = 0,
           tre_tre = 0;
    for (int run = 0; run < kRuns; ++run) {
      auto noisy = pairs;
      for (PointPair& pair : noisy)
        pair.tracked += Vector<Tracker>(0.5 * pair.fle_mm / std::sqrt(3) * test::normal(random));
      const auto found = register_points(noisy);
      ASSERT_TRUE(found);
      const double away = (found->patient_from_tracker * Point<Tracker>(target.eigen()) - target).norm();
      squares += away * away;
      below += away < predicted.max_mm;
      scales += found->fle_scale * found->fle_scale;
      within += found->min_fle_scale < 0.5 && 0.5 < found->max_fle_scale;
      fre += found->fre_mm, tre += away, both += found->fre_mm * away,
          fre_fre += found->fre_mm * found->fre_mm, tre_tre += away * away;
    }
    EXPECT_NEAR(std::sqrt(squares / kRuns) / predicted.rms_mm, 1, 0.02);
    EXPECT_NEAR(below / kRuns, 0.95, 0.01);
    EXPECT_NEAR(scales / kRuns, 0.25, 0.01);
    EXPECT_NEAR(within / kRuns, 0.95, 0.01);
    // the FRE does not predict the TRE
    const double correlation =
        (both / kRuns - fre / kRuns * tre / kRuns) / std::sqrt((fre_fre / kRuns - std::pow(fre / kRuns, 2)) *
                                                               (tre_tre / kRuns - std::pow(tre / kRuns, 2)));
    if (!weighted) {
      EXPECT_LT(std::abs(correlation), 0.03);
    }
  }
}

TEST(RegisterPoints, RejectsDegeneratePoints) {
  const auto refused = [](std::vector<PointPair> pairs) {
    const auto found = register_points(pairs);
    return found ? std::string("accepted") : found.error().message();
  };
  EXPECT_THAT(refused(pairs_of({{0, 0, 0}, {1, 0, 0}}, {})),
              HasSubstr("at least three pairs, but there are 2"));
  EXPECT_THAT(refused(pairs_of({{0, 0, 0}, {50, 0, 0}, {100, 0.5, 0}}, {})), HasSubstr("nearly collinear"));
  EXPECT_THAT(refused(pairs_of({{0, 0, 0}, {0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, {})),
              HasSubstr("nearly collinear"));
  auto mirrored = pairs_of({{0, 0, 0}, {80, 5, 0}, {10, 60, 8}, {-20, 30, 40}}, {});
  for (PointPair& pair : mirrored) pair.tracked = {-pair.tracked.x(), pair.tracked.y(), pair.tracked.z()};
  EXPECT_THAT(refused(mirrored), HasSubstr("mirror images"));
  auto broken = pairs_of(cube_corners(), {});
  broken[2].tracked = {NAN, 0, 0};
  EXPECT_THAT(refused(broken), HasSubstr("coordinates of P3"));
  broken = pairs_of(cube_corners(), {});
  broken[1].fle_mm = 0;
  EXPECT_THAT(refused(broken), HasSubstr("error of P2"));
  // coplanar points are not collinear, and have no distinct mirror image
  EXPECT_EQ(refused(pairs_of({{0, 0, 0}, {50, 0, 0}, {50, 40, 0}, {0, 40, 0}}, {})), "accepted");
}

}  // namespace
}  // namespace palpate
