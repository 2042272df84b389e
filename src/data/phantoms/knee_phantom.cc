#include <algorithm>

#include "phantoms/knee_phantom_anatomy.h"

namespace palpate {
namespace {

constexpr LabelId kLesionLabel = 200;
constexpr Rgb kLesionColour{214, 80, 70};
// larger than the thickness of any cartilage along its normal
constexpr double kThroughCartilage_mm = 6;

PhantomPart& part_named(std::vector<PhantomPart>& parts, const std::string& name) {
  const auto found = std::ranges::find(parts, name, &PhantomPart::name);
  PALPATE_CHECK(found != parts.end());
  return *found;
}

// a missing structure is replaced by fluid
void leave_out(PhantomPart& part) {
  part.label = 0;
  part.material = PhantomMaterial::kFluid;
}

void add_defect(std::vector<PhantomPart>& parts, const KneeParameters& knee, const Eigen::Vector3d& scale) {
  PhantomPart& cartilage = part_named(parts, knee.defect_in);
  const KneeSite site = knee_site(knee.defect_in, cartilage.shape);
  const Vector<Patient> through = kThroughCartilage_mm * site.normal;
  // a cylinder with the patient's radius converted to the anatomy's millimetres
  const Shape hole =
      Shape::cylinder(site.point - through, site.point + through, knee.defect_mm / scale.mean());
  const Shape whole = cartilage.shape;
  cartilage.shape = Shape::subtract(whole, hole);
  const Shape removed = Shape::intersect(whole, hole);
  // painted before the bone, as the cartilage was
  const auto iterator = parts.begin() + (&cartilage - parts.data());
  parts.insert(iterator, {"cartilage_defect", 0, {}, PhantomMaterial::kFluid, removed});
}

void add_lesion(std::vector<PhantomPart>& parts, const KneeParameters& knee, const Eigen::Vector3d& scale) {
  const Shape structure = part_named(parts, knee.lesion_in).shape;
  const KneeSite site = knee_site(knee.lesion_in, structure, knee.lesion_at);
  // a sphere in patient coordinates, whatever the anatomy's scale
  const Eigen::Vector3d depth = (knee.lesion_depth_mm * site.normal.eigen()).cwiseQuotient(scale);
  const Point<Patient> centre = site.point - Vector<Patient>(depth);
  const Eigen::Vector3d radii = Eigen::Vector3d::Constant(knee.lesion_mm).cwiseQuotient(scale);
  parts.push_back({"lesion", kLesionLabel, kLesionColour,
                   knee.visible ? PhantomMaterial::kLesion : PhantomMaterial::kInvisible,
                   Shape::intersect(structure, Shape::ellipsoid(centre, radii))});
}

}  // namespace

PhantomField field_of(const KneeParameters& knee) {
  return {{110, 110, 120}, {0, -4, 0}, knee.size * knee_shape(knee.settings.seed).stretch};
}

PhantomPlan plan_of(const KneeParameters& knee) {
  PhantomPlan plan;
  plan.field = field_of(knee);
  plan.mirrored = knee.side == BodySide::kRight;
  plan.parts = knee_phantom_parts(knee_shape(knee.settings.seed));
  if (knee.defect_mm > 0) add_defect(plan.parts, knee, plan.field.scale);
  if (knee.lesion_mm > 0) add_lesion(plan.parts, knee, plan.field.scale);
  for (const std::string& name : knee.missing) leave_out(part_named(plan.parts, name));
  return plan;
}

}  // namespace palpate
