#include "phantoms/palpation_phantoms.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <numbers>

#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

// Block and dome of soft tissue on a rigid plate, with nodules. The patient lies supine: the palpated surface
// faces -y, and the plate's surface is at y = 0 for the dome, at y = thickness for the block.
namespace palpate {
namespace {

using P = Point<Patient>;
using V = Vector<Patient>;

constexpr LabelId kTissueLabel = 1, kPlateLabel = 2, kNoduleLabel = 3;
constexpr Rgb kTissueColour{222, 184, 150}, kPlateColour{150, 160, 170}, kNoduleColour{214, 80, 70};

constexpr double kPlate_mm = 5;
// minimum thickness of soft tissue between a nodule and the plate, and between a nodule and a side
constexpr double kBelow_mm = 2, kBeside_mm = 4;
// minimum distance between the centres of two nodules, in diameters
constexpr double kApart = 1.5;

// Places nodules at random in a disc around the middle, seen from above; with seed 0 the first one is in the
// middle.
// @param reach_mm   radius of the disc
// @param nodule_at  nodule at a position x, z in the disc; nullopt if none fits there
std::optional<std::vector<PhantomNodule>> nodules_in_disc(
    const NoduleParameters& requested, std::uint64_t seed, double reach_mm,
    const std::function<std::optional<PhantomNodule>(double, double)>& nodule_at) {
  constexpr int kCasts = 1000;
  if (requested.nodules > 0 && reach_mm < 0) return std::nullopt;
  // PhantomVariation does not vary with seed 0
  PhantomVariation chance(seed == 0 ? std::numeric_limits<std::uint64_t>::max() : seed);
  std::vector<PhantomNodule> nodules;
  for (std::uint64_t n = 0; n < requested.nodules; ++n) {
    bool placed = false;
    for (int cast = 0; cast < kCasts && !placed; ++cast) {
      const double part = seed == 0 && n == 0 ? 0 : chance.within(0, 1, 0);
      const double radius = reach_mm * std::sqrt(part);
      const double angle = chance.within(0, 2 * std::numbers::pi, 0);
      const auto nodule = nodule_at(radius * std::cos(angle), radius * std::sin(angle));
      if (!nodule) continue;
      placed = std::ranges::all_of(nodules, [&](const PhantomNodule& other) {
        return (nodule->centre - other.centre).norm() >= kApart * requested.diameter_mm;
      });
      if (placed) nodules.push_back(*nodule);
    }
    if (!placed) return std::nullopt;
  }
  return nodules;
}

void add_parts(PhantomPlan& plan, const Shape& tissue, const Shape& plate, const NoduleParameters& requested,
               const std::optional<std::vector<PhantomNodule>>& nodules) {
  // check_phantom() has rejected parameters that do not fit
  PALPATE_CHECK(nodules.has_value());
  plan.parts.push_back({"plate", kPlateLabel, kPlateColour, PhantomMaterial::kPlastic, plate});
  plan.parts.push_back({"soft_tissue", kTissueLabel, kTissueColour, PhantomMaterial::kGland, tissue});
  if (nodules->empty()) return;
  std::vector<Shape> balls;
  for (const PhantomNodule& nodule : *nodules)
    balls.push_back(Shape::sphere(nodule.centre, nodule.radius_mm));
  plan.parts.push_back({"nodule", kNoduleLabel, kNoduleColour,
                        requested.visible ? PhantomMaterial::kLesion : PhantomMaterial::kInvisible,
                        Shape::unite(std::move(balls))});
}

// ellipsoid of which the dome is one half
Shape whole_dome(const DomeParameters& dome) {
  return Shape::ellipsoid(P(0, 0, 0), {dome.radius_mm, dome.height_mm, dome.radius_mm});
}

}  // namespace

std::optional<std::vector<PhantomNodule>> nodules_of(const BlockParameters& block) {
  const NoduleParameters& nodules = block.nodules;
  const double radius = 0.5 * nodules.diameter_mm, deep = nodules.depth_mm + radius;
  const double reach = 0.5 * block.width_mm - radius - kBeside_mm;
  const bool fits = deep + radius + kBelow_mm <= block.thickness_mm;
  return nodules_in_disc(nodules, block.settings.seed, reach, [&](double x, double z) {
    return fits ? std::optional(PhantomNodule{P(x, deep, z), radius, P(x, 0, z)}) : std::nullopt;
  });
}

std::optional<std::vector<PhantomNodule>> nodules_of(const DomeParameters& dome) {
  const NoduleParameters& nodules = dome.nodules;
  const double radius = 0.5 * nodules.diameter_mm, deep = nodules.depth_mm + radius;
  const double wide = dome.radius_mm * dome.radius_mm, high = dome.height_mm * dome.height_mm;
  // farther out the surface is too steep to be palpated from above
  constexpr double kPart = 0.6;
  const Shape whole = whole_dome(dome);
  return nodules_in_disc(nodules, dome.settings.seed, kPart * dome.radius_mm,
                         [&](double x, double z) -> std::optional<PhantomNodule> {
                           const P surface(x, -dome.height_mm * std::sqrt(1 - (x * x + z * z) / wide), z);
                           const V outward = V(x / wide, surface.y() / high, z / wide).normalized();
                           const P centre = surface - deep * outward;
                           if (centre.y() + radius + kBelow_mm > 0) return std::nullopt;
                           // deeper than the radius of curvature, another point of the surface would be
                           // nearer
                           constexpr double kRounding_mm = 1e-6;
                           if (whole.distance_mm(centre) > kRounding_mm - deep) return std::nullopt;
                           return PhantomNodule{centre, radius, surface};
                         });
}

PhantomField field_of(const BlockParameters& block) {
  const double across = block.width_mm + 2 * kFreeAround_mm;
  const double min_y = -kFreeAbove_mm, max_y = block.thickness_mm + kPlate_mm + kFreeAround_mm;
  return {{across, max_y - min_y, across}, {0, 0.5 * (min_y + max_y), 0}};
}

PhantomPlan plan_of(const BlockParameters& block) {
  PhantomPlan plan;
  plan.field = field_of(block);
  const double half = 0.5 * block.width_mm, thick = block.thickness_mm;
  add_parts(plan, Shape::box(P(0, 0.5 * thick, 0), {half, 0.5 * thick, half}),
            Shape::box(P(0, thick + 0.5 * kPlate_mm, 0), {half, 0.5 * kPlate_mm, half}), block.nodules,
            nodules_of(block));
  return plan;
}

PhantomField field_of(const DomeParameters& dome) {
  const double across = 2 * (dome.radius_mm + 2 * kFreeAround_mm);
  const double min_y = -dome.height_mm - kFreeAbove_mm, max_y = kPlate_mm + kFreeAround_mm;
  return {{across, max_y - min_y, across}, {0, 0.5 * (min_y + max_y), 0}};
}

PhantomPlan plan_of(const DomeParameters& dome) {
  PhantomPlan plan;
  plan.field = field_of(dome);
  const double half = dome.radius_mm + kFreeAround_mm;
  add_parts(plan, Shape::intersect(whole_dome(dome), Shape::half_space(P(0, 0, 0), V(0, 1, 0))),
            Shape::box(P(0, 0.5 * kPlate_mm, 0), {half, 0.5 * kPlate_mm, half}), dome.nodules,
            nodules_of(dome));
  return plan;
}

}  // namespace palpate
