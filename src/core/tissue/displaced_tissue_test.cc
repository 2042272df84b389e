#include "palpate/tissue/displaced_tissue.h"

#include <gtest/gtest.h>

#include <cmath>

#include "palpate/tissue/soft_tissue_solver.h"
#include "tissue/test_soft_block.h"

namespace palpate {
namespace {

using testing::pressed_at;
using testing::soft_block;

TickRecord pressed_with(double x, double y, double force_N) {
  TickRecord record = pressed_at(x, y);
  record.device[0].contact_N[0] = force_N;
  record.device[0].depth_mm = 1;
  return record;
}

TEST(DisplacedTissue, DisplacementMatchesTheCompliance) {
  const auto model = soft_block(false);
  // the patch has the least radius, whatever the force
  constexpr double kForce_N = 0.05;
  const DisplacedTissue deformed(*model, pressed_with(0, 0, kForce_N));
  ASSERT_FALSE(deformed.is_at_rest());
  SoftTissueSolver solver;
  for (int n = 0; n < 12; ++n) solver.solve(*model, pressed_with(0, 0, kForce_N));
  const LocalCompliance& local = solver.frame().local_compliance[0];
  // mean under the patch, weighted by its pressure
  double sum = 0, weights = 0;
  constexpr int kSteps = 20;
  for (int a = -kSteps; a <= kSteps; ++a)
    for (int b = -kSteps; b <= kSteps; ++b) {
      const double x = local.patch_radius_mm * a / kSteps, y = local.patch_radius_mm * b / kSteps;
      const double inside = 1 - (x * x + y * y) / (local.patch_radius_mm * local.patch_radius_mm);
      if (!(inside > 0)) continue;
      sum -= std::sqrt(inside) * deformed.displacement_mm({x, y, 0}).z();
      weights += std::sqrt(inside);
    }
  EXPECT_NEAR(sum / weights / (kForce_N * local.compliance_mm_per_N), 1, 0.02);
  // proportional to the force
  const DisplacedTissue twice(*model, pressed_with(0, 0, 2 * kForce_N));
  const Point<Patient> deep(3, -2, -6);
  EXPECT_LT((twice.displacement_mm(deep) - deformed.displacement_mm(deep) * 2).norm(),
            0.01 * twice.displacement_mm(deep).norm());
}

TEST(DisplacedTissue, EmptySpaceFollowsWithoutFolding) {
  const DisplacedTissue deformed(*soft_block(true), pressed_with(0, 0, 0.3));
  const double dent_mm = -deformed.displacement_mm({0, 0, 0}).z();
  EXPECT_GT(dent_mm, 1.5);
  EXPECT_NEAR(-deformed.displacement_mm({0, 0, 1}).z() / dent_mm, 1, 0.25);
  double before = -1e9;
  for (double z = -19; z < 38; z += 0.05) {
    const double observed = z + deformed.displacement_mm({0, 0, z}).z();
    ASSERT_GT(observed, before) << "folded at " << z;
    before = observed;
  }
  // bone is fixed, and distant tissue is at rest
  EXPECT_EQ(deformed.displacement_mm({0, 0, -25}).norm(), 0);
  EXPECT_EQ(deformed.displacement_mm({0, 0, 39.9}).norm(), 0);
  EXPECT_EQ(deformed.displacement_mm({200, 0, -5}).norm(), 0);
  EXPECT_EQ(deformed.displacement_mm({kNoValue, 0, -5}).norm(), 0);
}

TEST(DisplacedTissue, StrainMatchesTheDisplacementGradient) {
  const DisplacedTissue deformed(*soft_block(true), pressed_with(0, 0, 0.3));
  // at the centre of a cell (1.5 mm, with its corner at the volume's), where strain follows from its corners
  const Point<Patient> corner(-40.5, -40.5, -41);
  for (const Eigen::Vector3d& cells :
       {Eigen::Vector3d(27.5, 27.5, 24.5), Eigen::Vector3d(29.5, 26.5, 25.5)}) {
    const Point<Patient> centre = corner + Vector<Patient>(1.5 * cells);
    Eigen::Matrix3d gradient = Eigen::Matrix3d::Identity();
    for (int axis = 0; axis < 3; ++axis) {
      Eigen::Vector3d displacement = Eigen::Vector3d::Zero();
      displacement[axis] = 0.01;
      gradient.col(axis) += (deformed.displacement_mm(centre + Vector<Patient>(displacement)) -
                             deformed.displacement_mm(centre - Vector<Patient>(displacement)))
                                .eigen() /
                            0.02;
    }
    const Eigen::Matrix3d back = gradient.inverse();
    Eigen::Matrix3d e = 0.5 * (Eigen::Matrix3d::Identity() - back.transpose() * back);
    e -= Eigen::Matrix3d::Identity() * e.trace() / 3;
    EXPECT_GT(deformed.strain(centre), 0.005);
    EXPECT_NEAR(deformed.strain(centre), std::sqrt((e.cwiseProduct(e)).sum() * 2 / 3), 1e-4);
  }
  // the hard ball keeps its shape, the soft tissue above it does not
  EXPECT_LT(deformed.strain({0, 0, -9}), 0.3 * deformed.strain({0, 0, -4}));
  EXPECT_TRUE(std::isnan(deformed.strain({0, 0, 5})));
  EXPECT_TRUE(std::isnan(deformed.strain({200, 0, -5})));
}

TEST(DisplacedTissue, DisplacementsOfTwoToolsSuperpose) {
  const auto model = soft_block(false);
  const TickRecord one = pressed_with(-6, 0, 0.2), other = pressed_with(6, 2, 0.1);
  TickRecord both = one;
  both.devices = 2;
  both.device[1] = other.device[0];
  const Point<Patient> between(0, 1, -3);
  const Vector<Patient> sum = DisplacedTissue(*model, one).displacement_mm(between) +
                              DisplacedTissue(*model, other).displacement_mm(between);
  EXPECT_LT((DisplacedTissue(*model, both).displacement_mm(between) - sum).norm(), 1e-9);
  EXPECT_GT(sum.norm(), 0.05);
}

TEST(DisplacedTissue, IsAtRestWithoutSoftContact) {
  const auto model = soft_block(false);
  EXPECT_TRUE(DisplacedTissue(*model, testing::tool_at({0, 0, 5})).is_at_rest());
  TickRecord on_bone = pressed_with(0, 0, 1);
  on_bone.device[0].contact_label[0] = 3;
  EXPECT_TRUE(DisplacedTissue(*model, on_bone).is_at_rest());
  auto layers = std::make_shared<Model>(*model);
  layers->tissue_law = TissueLaw::kLayers;
  EXPECT_TRUE(DisplacedTissue(*layers, pressed_with(0, 0, 1)).is_at_rest());
  EXPECT_EQ(DisplacedTissue().displacement_mm({0, 0, 0}).norm(), 0);
}

}  // namespace
}  // namespace palpate
