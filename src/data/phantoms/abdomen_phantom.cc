#include "phantoms/palpation_phantoms.h"
#include "phantoms/phantom_plan.h"
#include "phantoms/phantom_variation.h"

// Abdominal wall of skin, fat and muscle, over the structures to be palpated: the lower edge of a liver, and
// a rib above it. The patient lies supine: the skin is at y = 0 and faces -y, +z is superior.
namespace palpate {
namespace {

using P = Point<Patient>;
using V = Vector<Patient>;

constexpr double kHalf_mm = 40;  // half extent along x and z
// space for the liver below the muscle, and the support below it
constexpr double kInside_mm = 25, kBack_mm = 4;
constexpr double kRib_mm = 5;  // radius

Shape slab(double from_y, double to_y) {
  return Shape::box(P(0, 0.5 * (from_y + to_y), 0), {kHalf_mm, 0.5 * (to_y - from_y), kHalf_mm});
}

}  // namespace

PhantomField field_of(const AbdomenParameters& abdomen) {
  const double across = 2 * (kHalf_mm + kFreeAround_mm);
  const double deep = abdomen.skin_mm + abdomen.fat_mm + abdomen.muscle_mm + kInside_mm + kBack_mm;
  return {{across, kFreeAbove_mm + deep + kFreeAround_mm, across},
          {0, 0.5 * (deep + kFreeAround_mm - kFreeAbove_mm), 0}};
}

PhantomPlan plan_of(const AbdomenParameters& abdomen) {
  using enum PhantomMaterial;
  PhantomPlan plan;
  plan.field = field_of(abdomen);
  PhantomVariation chance(abdomen.settings.seed);
  const double fat = abdomen.skin_mm, muscle = fat + abdomen.fat_mm, inside = muscle + abdomen.muscle_mm;
  const double back = inside + kInside_mm;
  // the edge runs across with a slight tilt, the rib with a larger one
  const double edge_z = -8 + chance.offset(8), askew = chance.offset(0.15);
  const double rib_z = 24 + chance.offset(5), slope = 0.25 + chance.offset(0.1);

  plan.parts.push_back({"back", 8, {150, 160, 170}, kPlastic, slab(back, back + kBack_mm)});
  plan.parts.push_back({"viscera", 7, {214, 160, 140}, kGland, slab(inside, back)});

  // a wedge with a thin lower edge, which is in contact with the wall
  const double edge_y = inside + 7;
  const V down = V(askew, 0.25, -1).normalized();
  const Shape below_wall = slab(inside, back);
  const Shape under_side = Shape::half_space(P(0, edge_y + 4, edge_z), V(0, 1, -0.7).normalized());
  const Shape to_edge = Shape::half_space(P(0, edge_y, edge_z), down);
  const Shape liver = Shape::intersect(Shape::intersect(below_wall, under_side), to_edge);
  plan.parts.push_back({"liver", 4, {160, 70, 60}, kMuscle, liver});
  if (abdomen.edge_mm > 0) {
    const V along = V(1, 0, askew).normalized();
    const P middle(0, inside + abdomen.edge_mm, edge_z);
    const Shape rim =
        Shape::capsule(middle - 2 * kHalf_mm * along, middle + 2 * kHalf_mm * along, abdomen.edge_mm);
    plan.parts.push_back({"liver_edge", 5, {120, 40, 40}, kMuscle, Shape::intersect(rim, below_wall)});
  }

  plan.parts.push_back({"muscle", 3, {190, 80, 80}, kMuscle, slab(muscle, inside)});
  if (abdomen.fat_mm > 0) plan.parts.push_back({"fat", 2, {240, 220, 130}, kFat, slab(fat, muscle)});
  plan.parts.push_back({"skin", 1, {225, 180, 150}, kSkin, slab(0, fat)});
  if (abdomen.rib) {
    // directly below the muscle
    const P middle(0, inside + kRib_mm, rib_z);
    const V along = V(1, 0, -slope).normalized();
    const Shape rib = Shape::capsule(middle - 2 * kHalf_mm * along, middle + 2 * kHalf_mm * along, kRib_mm);
    plan.parts.push_back({"rib", 6, {235, 225, 200}, kBone, Shape::intersect(rib, below_wall)});
  }
  return plan;
}

}  // namespace palpate
