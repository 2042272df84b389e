#include <cmath>
#include <numbers>

#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

// Arch of a lower jaw, anterior -y, and a gland on its front, to the left of the middle. Fat and skin are
// shells around both, cut to the outside of the mouth; adjacent structures are in contact.
namespace palpate {
namespace {

using P = Point<Patient>;
using V = Vector<Patient>;

constexpr Rgb kJawColour{197, 189, 177}, kGlandColour{212, 160, 90}, kFatColour{240, 220, 130},
    kSkinColour{225, 180, 150};

// half an ellipse of capsules at three heights, with the rami behind it and a chin
Shape jaw(double width, double depth) {
  constexpr int kLinks = 10;
  const auto arch = [&](int n, double z) {
    const double angle = n * std::numbers::pi / (2 * kLinks);
    return P(width * 48 * std::sin(angle), depth * (42 - 76 * std::cos(angle)), z);
  };
  std::vector<Shape> bone;
  for (const double z : {-9.0, 0.0, 9.0}) {
    std::vector<Shape> links;
    for (int n = -kLinks; n < kLinks; ++n) links.push_back(Shape::capsule(arch(n, z), arch(n + 1, z), 6));
    bone.push_back(Shape::unite(links));
  }
  std::vector<Shape> rami;
  for (const double side : {-1.0, 1.0}) {
    rami.push_back(
        Shape::capsule(P(side * width * 48, depth * 42, -5), P(side * width * 51, depth * 52, 40), 6));
    rami.push_back(
        Shape::capsule(P(side * width * 47, depth * 32, 5), P(side * width * 50, depth * 40, 38), 5));
  }
  bone.push_back(Shape::unite(rami));
  bone.push_back(Shape::sphere(P(0, depth * -35, -9), 8));
  return Shape::blend(bone, 5);
}

// intersection of a ray from outside with the bone, by sphere tracing
P on_surface(const Shape& bone, const P& eye, const V& towards) {
  const V step = towards.normalized();
  double distance = 0, free = 1;
  while (free > 1e-6 && distance < 200) {
    free = bone.distance_mm(eye + distance * step);
    distance += free;
  }
  PALPATE_CHECK(distance < 200);
  return eye + distance * step;
}

}  // namespace

PhantomField field_of(const GlandParameters& gland) {
  // dimensions of the soft layers in mm are independent of the scale
  const double cover = (gland.gland_mm + gland.fat_mm + gland.skin_mm) / gland.size;
  const double min_x = -64 - cover, max_x = 64 + cover, min_y = -48 - cover;
  return {
      {max_x - min_x, 72 - min_y, 104}, {0, 0.5 * (72 + min_y), 12}, Eigen::Vector3d::Constant(gland.size)};
}

PhantomPlan plan_of(const GlandParameters& gland) {
  using enum PhantomMaterial;
  PhantomPlan plan;
  plan.field = field_of(gland);
  PhantomVariation chance(gland.settings.seed);
  const double width = chance.factor(0.06), depth = chance.factor(0.06);
  const double half = 0.5 * gland.gland_mm / gland.size;
  const double turn = chance.offset(0.15), thick = 0.62 * chance.factor(0.1),
               high = 0.76 * chance.factor(0.1);

  const Shape bone = jaw(width, depth);
  // the centre is less than half the gland's thickness away from the bone, so that they are in contact
  const V inward = V(-0.6, 0.8, 0).normalized();
  const P surface = on_surface(bone, P(28 * width, -17 * depth, chance.offset(3)) - 90 * inward, inward);
  const Eigen::Matrix3d axes =
      Eigen::AngleAxisd(std::atan2(0.6, 0.8) + turn, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  const Shape whole =
      Shape::ellipsoid(surface - 0.3 * half * inward, {half, thick * half, high * half}, axes);
  const Shape body = Shape::subtract(whole, bone);

  const Shape both = Shape::unite({bone, body});
  // interior of the mouth; its border runs through the middle of the bone
  const Shape mouth = Shape::ellipsoid(P(0, 40 * depth, 0), {44 * width, 74 * depth, 400});
  const auto layer = [&](double from, double to) {
    return Shape::subtract(Shape::subtract(Shape::offset(both, to), Shape::offset(both, from)), mouth);
  };
  const double fat = gland.fat_mm / gland.size, skin = gland.skin_mm / gland.size;
  if (skin > 0) plan.parts.push_back({"skin", 4, kSkinColour, kSkin, layer(fat, fat + skin)});
  if (fat > 0) plan.parts.push_back({"fat", 3, kFatColour, kFat, layer(0, fat)});
  plan.parts.push_back({"gland", 2, kGlandColour, kGland, body});
  plan.parts.push_back({"mandible", 1, kJawColour, kBone, bone});
  return plan;
}

}  // namespace palpate
