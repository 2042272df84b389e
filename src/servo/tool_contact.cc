#include "servo/tool_contact.h"

namespace palpate {
namespace {

// below this the halo of a smoothed structure is not called a touch
constexpr double kTouch_N = 0.02;

PointContact touch(const Model& model, const Parameters& parameters, const Point<Patient>& x,
                   const Vector<Patient>& velocity_mm_s) {
  const ForceField& field = model.force_field(parameters.method);
  PointContact contact;
  contact.sample = field.sample(x);
  const Vector<Patient> normal_N = normal_force(contact.sample, field.full_force_N());
  contact.force_N = normal_N;
  contact.site = find_contact_site(model, x, contact.sample);
  if (contact.site.tissue < 0) return contact;

  const Tissue& tissue = model.tissues[contact.site.tissue];
  if (parameters.friction) contact.force_N += pseudo_friction(tissue, velocity_mm_s, normal_N);
  if (parameters.viscosity)
    contact.force_N += viscous_force(tissue, velocity_mm_s, contact.sample.value / contact.site.level);
  return contact;
}

}  // namespace

bool PointContact::is_touch() const {
  const bool inside = sample.value >= 0.5 * site.level;
  return site.label != 0 && (inside || force_N.norm() >= kTouch_N);
}

ToolContact touch_with_tool(const Model& model, const Parameters& parameters, const DeviceParameters& gains,
                            const Eigen::Quaterniond& R_WorldTool, const Point<Patient>& tip,
                            const Vector<Patient>& velocity_mm_s,
                            const Transform<World, Patient>& X_WorldPatient,
                            const Transform<Patient, World>& X_PatientWorld) {
  const Eigen::Matrix3d turn = R_WorldTool.normalized().toRotationMatrix();
  ToolContact tool;
  bool first = true;
  for (const Eigen::Vector3d& offset_mm : model.tool.points_mm) {
    const Vector<World> arm_mm(turn * offset_mm);
    const PointContact contact = touch(model, parameters, tip + X_PatientWorld * arm_mm, velocity_mm_s);
    const Vector<World> force_N = X_WorldPatient * contact.force_N;
    tool.asked.force_N += force_N * gains.force_gain;
    tool.asked.torque_Nmm += arm_mm.cross(force_N) * (gains.force_gain / gains.scale);
    if (first || contact.force_N.squared_norm() > tool.strongest.force_N.squared_norm())
      tool.strongest = contact;
    first = false;
  }
  return tool;
}

}  // namespace palpate
