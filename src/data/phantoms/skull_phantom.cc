#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

// Cranium, anterior -y: an ellipsoid with a flat base. A wall lies between a surface and the same surface
// offset inwards, and is nowhere thinner than the offset: where surfaces are blended, their distance
// underestimates the true one.
namespace palpate {
namespace {

using P = Point<Patient>;
using V = Vector<Patient>;

constexpr double kScalp_mm = 6;
constexpr double kFluid_mm = 1.5;  ///< Gap between brain and wall.
constexpr double kCanal_mm = 2.5;  ///< Radius.
constexpr Rgb kBoneColour{230, 220, 195}, kBrainColour{225, 170, 165};

Shape both_sides(const auto& make) {
  return Shape::unite({make(-1.0), make(1.0)});
}

Shape cranium(const Eigen::Vector3d& radii) {
  return Shape::intersect(Shape::ellipsoid(P(0, 0, 0), radii), Shape::half_space(P(0, 0, -46), V(0, 0, -1)),
                          20);
}

// ellipsoids whose long axes converge towards the middle
Shape orbits(double front_y) {
  return both_sides([&](double side) {
    const Eigen::Matrix3d axes = Eigen::AngleAxisd(side * 0.3, Eigen::Vector3d::UnitZ()).toRotationMatrix();
    return Shape::ellipsoid(P(side * 31, front_y + 18, -20), {17.5, 30, 16}, axes);
  });
}

Shape optic_canals(double front_y) {
  return both_sides([&](double side) {
    return Shape::capsule(P(side * 25, front_y + 42, -20), P(side * 17, front_y + 66, -20), kCanal_mm);
  });
}

}  // namespace

PhantomField field_of(const SkullParameters& skull) {
  return {{190, 234, 160}, {0, 0, 14}, Eigen::Vector3d::Constant(skull.size)};
}

PhantomPlan plan_of(const SkullParameters& skull) {
  using enum PhantomMaterial;
  PhantomPlan plan;
  plan.field = field_of(skull);
  plan.imaging = PhantomImaging::kCt;
  // wall thicknesses in mm are independent of the scale
  const double thick = skull.thickness_mm / skull.size, thin = skull.temporal_mm / skull.size;
  PhantomVariation chance(skull.settings.seed);
  const Eigen::Vector3d radii(72 * chance.factor(0.06), 92 * chance.factor(0.06), 74 * chance.factor(0.06));
  const double temple_y = -14 + chance.offset(4), temple_z = -6 + chance.offset(4);
  const double front_y = -0.86 * radii[1] + chance.offset(2);

  const Shape outer = cranium(radii);
  const Shape temples = both_sides([&](double side) {
    return Shape::ellipsoid(P(side * radii[0], temple_y, temple_z), {26, 27, 22});
  });
  const Shape inner =
      Shape::unite({Shape::offset(outer, -thick), Shape::intersect(Shape::offset(outer, -thin), temples, 8)});
  const Shape sockets = orbits(front_y);
  const Shape walls =
      Shape::unite({Shape::subtract(outer, inner), Shape::intersect(Shape::offset(sockets, thin), outer)});
  const Shape bone = Shape::subtract(walls, Shape::unite({sockets, optic_canals(front_y)}));
  const Shape brain =
      Shape::subtract(Shape::offset(inner, -kFluid_mm), Shape::offset(sockets, thin + kFluid_mm));

  plan.parts = {{"scalp", 0, {}, kSkin, Shape::offset(outer, kScalp_mm)},
                {"orbital_fat", 0, {}, kFat, sockets}};
  if (skull.brain) {
    plan.parts.push_back({"cerebrospinal_fluid", 0, {}, kFluid, Shape::subtract(inner, sockets)});
    plan.parts.push_back({"brain", 2, kBrainColour, kBrain, brain});
  }
  plan.parts.push_back({"skull", 1, kBoneColour, kBone, bone});
  return plan;
}

}  // namespace palpate
