#include "palpate/tissue/elastic_contact.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "tissue/test_elastic_scenes.h"

namespace palpate {
namespace {

using testing::soft;

/// A nodule in a layer on bone, in axes rotated by `axes` relative to the patient's.
class TissueWithNodule : public ::testing::Test {
 protected:
  TissueWithNodule() : grid_(make()), solver_(grid_), u_(grid_.layout()), load_(grid_.layout()) {}

  static ElasticGrid make() {
    ElasticBox box = testing::elastic_box({23, 20, 9});
    box.axes = Eigen::AngleAxisd(0.6, Eigen::Vector3d(1, 2, -1).normalized()).toRotationMatrix();
    box.corner = Point<Patient>(30, -12, 5);
    const Point<Patient> nodule = box.patient({11, 10, 5});
    ElasticGrid grid(
        box, [=](const Point<Patient>& p) { return soft((p - nodule).norm() < 2.5 ? 100 : 10, 0.45); }, 2);
    for (int j = 0; j <= 20; ++j)
      for (int i = 0; i <= 23; ++i) grid.constrain(i, j, 0, ElasticGrid::kFixed);
    return grid;
  }
  Point<Patient> at(double x, double y, double z = 9) const { return grid_.box().patient({x, y, z}); }
  Vector<Patient> outward() const { return Vector<Patient>(grid_.box().axes.col(2)); }
  SphereContact press(double x, double y, double depth_mm) {
    return press_sphere(grid_, solver_, at(x, y), outward(), 5, depth_mm, u_, load_, 200, 1e-5);
  }

  ElasticGrid grid_;
  ElasticSolver solver_;
  ElasticField u_, load_;
};

TEST_F(TissueWithNodule, ComplianceIsSymmetricAndPositive) {
  std::mt19937 random(test::test_seed());
  std::uniform_real_distribution<double> coordinate(6, 15);
  std::vector<PressurePatch> patches;
  for (int n = 0; n < 8; ++n)
    patches.emplace_back(grid_, at(coordinate(random), coordinate(random)), outward(), 2.2);
  double residual = 1;
  const Eigen::MatrixXd w = contact_compliance_mm_per_N(solver_, patches, 1e-6, &residual);
  EXPECT_LE(residual, 1e-6);
  EXPECT_LE((w - w.transpose()).cwiseAbs().maxCoeff(), 1e-4 * w.cwiseAbs().maxCoeff());
  EXPECT_GT(w.selfadjointView<Eigen::Lower>().eigenvalues().minCoeff(), 0);
}

TEST_F(TissueWithNodule, PatchReproducesALinearField) {
  ElasticField u(grid_.layout());
  for (int k = 0; k <= 9; ++k)
    for (int j = 0; j <= 20; ++j)
      for (int i = 0; i <= 23; ++i)
        u.values[grid_.layout().node(i, j, k, 2)] = static_cast<float>(-0.1 - 0.02 * i + 0.03 * j);
  const PressurePatch patch(grid_, at(9.3, 11.2), outward(), 2.5);
  EXPECT_NEAR(patch.displacement_mm(u), 0.1 + 0.02 * 9.3 - 0.03 * 11.2, 2e-3);
  const Eigen::Vector3d change = grid_.box().axes.transpose() * patch.gradient_along_surface(u).eigen();
  EXPECT_LE((change - Eigen::Vector3d(0.02, -0.03, 0)).norm(), 1e-6);
  EXPECT_NEAR(patch.contact_modulus_N_per_mm2(), 0.01 / (1 - 0.45 * 0.45), 1e-6);
}

TEST_F(TissueWithNodule, EmptySpaceGivesNoForce) {
  EXPECT_FALSE(PressurePatch(grid_, at(9, 9, 14), outward(), 2).touches());
  EXPECT_EQ(press_sphere(grid_, solver_, at(9, 9, 14), outward(), 5, 1, u_, load_, 10, 1e-3).force_N, 0);
  EXPECT_EQ(press(9, 9, 0).force_N, 0);
  EXPECT_EQ(press(9, 9, -1).force_N, 0);
  EXPECT_EQ(press(9, 9, std::nan("")).force_N, 0);
}

TEST_F(TissueWithNodule, ForceGrowsWithDepthAndOverTheNodule) {
  double last = 0;
  for (const double depth : {0.01, 0.1, 0.5, 1.0, 2.0}) {
    const double force = press(11, 10, depth).force_N;
    EXPECT_GT(force, last);
    last = force;
  }
  EXPECT_GT(press(11, 10, 1).force_N, 1.1 * press(4, 10, 1).force_N);
}

// F2 / 2 grad W is the decrease of the energy along the surface: its integral is the energy difference
TEST_F(TissueWithNodule, TangentialForceIsTheComplianceGradient) {
  const double x0 = 6.2, x1 = 9.2, force_N = 0.05;
  constexpr int kSteps = 12;
  double sum = 0;
  for (int n = 0; n < kSteps; ++n) {
    const double x = x0 + (x1 - x0) * (n + 0.5) / kSteps;
    const PressurePatch patch(grid_, at(x, 10.3), outward(), 2);
    std::fill(load_.values.begin(), load_.values.end(), 0.0f);
    patch.add(1, load_);
    solver_.solve(load_, u_, 200, 1e-5);
    sum += force_N * force_N * patch.gradient_along_surface(u_).eigen().dot(grid_.box().axes.col(0)) *
           (x1 - x0) / kSteps;
  }
  const auto energy = [&](double x) {
    const PressurePatch patch(grid_, at(x, 10.3), outward(), 2);
    std::fill(load_.values.begin(), load_.values.end(), 0.0f);
    patch.add(1, load_);
    solver_.solve(load_, u_, 200, 1e-5);
    return force_N * force_N / 2 * patch.displacement_mm(u_);
  };
  const double fall = energy(x1) - energy(x0);
  EXPECT_LT(fall, 0);
  EXPECT_NEAR(sum / fall, 1, 0.1);
}

TEST(ContactForces, AreComplementary) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("seed " + std::to_string(test::test_seed()));
  std::normal_distribution<double> normal;
  for (int n = 0; n < 200; ++n) {
    const int count = 1 + static_cast<int>(random() % 24);
    Eigen::MatrixXd a(count, count);
    Eigen::VectorXd depth(count);
    for (double& one : a.reshaped()) one = normal(random);
    for (double& one : depth) one = normal(random);
    const Eigen::MatrixXd w = a * a.transpose() + 0.1 * Eigen::MatrixXd::Identity(count, count);
    const Eigen::VectorXd force = contact_forces(w, depth), gap = w * force - depth;
    EXPECT_GE(force.minCoeff(), 0);
    EXPECT_GE(gap.minCoeff(), -1e-6);
    EXPECT_LE(std::abs(force.dot(gap)), 1e-6 * (1 + force.norm()));
  }
}

}  // namespace
}  // namespace palpate
