#include <algorithm>
#include <cmath>
#include <span>

#include "palpate/base/insertion_sort.h"
#include "palpate/device/rendered_stiffness.h"
#include "palpate/direct/direct_methods.h"

namespace palpate {
namespace {

/// Contact of one point of the tool, and the magnitude of its normal force.
struct PointForce {
  PointContact contact;
  double normal_N = 0;
};

/// Contact of one point by a direct method.
/// @param full_force_N    force at field value 1
/// @param max_N_s_per_mm  limit of the total damping at this point
/// @param x               position of the point
PointForce touch(const TickContext& tick, double full_force_N, double max_N_s_per_mm, const Point<Patient>& x,
                 const Vector<Patient>& velocity_mm_s) {
  const ForceField& field = tick.model.force_field(tick.method);
  PointForce point;
  PointContact& contact = point.contact;
  contact.proxy = x;
  contact.sample = field.sample(x);
  const Vector<Patient> normal_N = normal_force(contact.sample, full_force_N);
  point.normal_N = normal_N.norm();
  contact.force_N = normal_N;
  contact.site = find_contact_site(tick.model, x, contact.sample);
  if (contact.site.tissue < 0) return point;

  const Tissue& tissue = tick.model.tissues[static_cast<std::size_t>(contact.site.tissue)];
  const double remaining_N_s_per_mm =
      tick.viscosity ? std::max(0.0, max_N_s_per_mm - tissue.viscosity_N_s_per_mm) : max_N_s_per_mm;
  if (tick.friction)
    contact.force_N += pseudo_friction(tissue, velocity_mm_s, normal_N, remaining_N_s_per_mm);
  if (tick.viscosity)
    contact.force_N +=
        viscous_force(tissue, velocity_mm_s, contact.sample.value / contact.site.level, max_N_s_per_mm);
  return point;
}

}  // namespace

Vector<Patient> pseudo_friction(const Tissue& tissue, const Vector<Patient>& velocity_mm_s,
                                const Vector<Patient>& normal_force_N, double max_N_s_per_mm) {
  const Vector<Patient> n = normal_force_N.normalized();
  const Vector<Patient> along_surface = velocity_mm_s - n * n.dot(velocity_mm_s);
  const double speed = along_surface.norm();
  if (speed == 0) return {};
  const double cap = std::min(tissue.friction_max_N, tissue.friction * normal_force_N.norm());
  const double magnitude =
      std::min(std::min(tissue.friction_damping_N_s_per_mm, max_N_s_per_mm) * speed, cap);
  return along_surface * (-magnitude / speed);
}

ToolContact touch_directly(const TickContext& tick, const DeviceContext& context) {
  const DeviceParameters& gains = context.device;
  const auto points = static_cast<double>(context.tool.points_mm.size());
  ToolContact tool;
  // forces of points in contact at the same time add up
  const double stiffness_N_per_mm = tick.model.max_stiffness_N_per_mm() * points;
  const double max_N_s_per_mm = context.max_damping_N_s_per_mm() / points;
  const double stiffness_factor = RenderedStiffness(gains).direct_method_factor(stiffness_N_per_mm);
  const double full_force_N = tick.model.force_field(tick.method).full_force_N() * stiffness_factor;
  tool.stiffness_N_per_mm = RenderedStiffness(gains).at_device(stiffness_N_per_mm * stiffness_factor);
  std::size_t contact_count = 0;
  for (std::size_t part = 0; part < context.tool.points_mm.size(); ++part) {
    const Vector<World> arm_mm(context.R_WorldTool * context.tool.points_mm[part]);
    const PointForce point = touch(tick, full_force_N, max_N_s_per_mm,
                                   context.tip + tick.X_PatientWorld * arm_mm, context.velocity_mm_s);
    const Vector<World> force_N = tick.X_WorldPatient * point.contact.force_N;
    tool.requested.force_N += force_N * gains.force_gain;
    tool.requested.torque_Nmm += arm_mm.cross(force_N) * (gains.force_gain / gains.scale);
    if (part == 0 || point.contact.force_N.squared_norm() > tool.strongest.force_N.squared_norm())
      tool.strongest = point.contact;
    if (!point.contact.is_contact()) continue;
    static_assert(kMaxContactsReported >= kMaxToolParts);
    tool.contacts[contact_count++] = {point.contact.site.label, static_cast<int>(part), point.contact.proxy,
                                      point.normal_N};
  }
  insertion_sort(std::span(tool.contacts).first(contact_count),
                 [](const ContactPoint& a, const ContactPoint& b) { return a.force_N > b.force_N; });
  tool.path[0] = {tool.strongest.site.label, tool.strongest.site.depth_mm, 1};
  return tool;
}

}  // namespace palpate
