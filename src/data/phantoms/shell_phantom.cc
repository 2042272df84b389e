#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

namespace palpate {
namespace {

// free space around the shell, from which a tip approaches
constexpr double kAround_mm = 15;

}  // namespace

PhantomField field_of(const ShellParameters& shell) {
  const double across = 2 * (shell.radius_mm + kAround_mm);
  return {{across, across, across}, {0, 0, 0}, {1, 1, 1}};
}

// An ellipsoid minus the same ellipsoid shrunk by the thickness: the wall thickness is uniform, because the
// distance to an ellipsoid is exact.
PhantomPlan plan_of(const ShellParameters& shell) {
  PhantomPlan plan;
  plan.field = field_of(shell);
  plan.imaging = PhantomImaging::kCt;
  PhantomVariation chance(shell.settings.seed);
  Eigen::Vector3d radii = Eigen::Vector3d::Constant(shell.radius_mm);
  for (int axis = 0; axis < 3; ++axis) radii[axis] *= chance.factor(0.08);
  // random position relative to the voxel lattice
  Eigen::Vector3d centre = Eigen::Vector3d::Zero();
  for (int axis = 0; axis < 3; ++axis) centre[axis] = chance.offset(2);
  const Shape outer = Shape::ellipsoid(Point<Patient>(centre), radii);
  const Shape wall = Shape::subtract(outer, Shape::offset(outer, -shell.thickness_mm));
  plan.parts.push_back({"shell", 1, {120, 170, 210}, PhantomMaterial::kPlastic, wall});
  return plan;
}

}  // namespace palpate
