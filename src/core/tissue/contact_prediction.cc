#include "tissue/contact_prediction.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/cube_root.h"
#include "palpate/tissue/soft_tissue_solver.h"

namespace palpate {
namespace {

template <class Tagged>
Tagged from_array(const std::array<double, 3>& v) {
  return {v[0], v[1], v[2]};
}

// Nearest point on the surfaces of the outermost layer, if it is within reach_mm. The sampled distance is not
// exact away from the surface, so the point is projected along the normal several times.
std::optional<PredictedContact> project_to_surface(const Model& model, const Point<Patient>& near) {
  constexpr int kSteps = 3;
  PredictedContact found{near, {}};
  for (int step = 0; step < kSteps; ++step) {
    const Surface* nearest = nullptr;
    double distance_mm = kSolverSettings.reach_mm;
    for (const ContactSurface& surface : model.surfaces) {
      if (surface.surface == nullptr || surface.layer != 0 || surface.covered_by >= 0) continue;
      if (surface.surface->is_farther_than(found.at, std::abs(distance_mm))) continue;
      const double mm = surface.surface->distance_mm(found.at);
      if (mm >= surface.surface->outside_mm() || std::abs(mm) >= std::abs(distance_mm)) continue;
      distance_mm = mm;
      nearest = surface.surface.get();
    }
    if (nearest == nullptr) return std::nullopt;
    found.outward = nearest->outward(found.at);
    if (found.outward == Vector<Patient>()) return std::nullopt;
    found.at = found.at - found.outward * distance_mm;
  }
  return found;
}

bool presses(const DeviceTick& device) {
  return device.contact_label[0] != 0 && device.depth_mm > 0;
}

}  // namespace

std::optional<PredictedContact> expected_contact(const Model& model, const DeviceTick& device) {
  const auto tip = from_array<Point<Patient>>(device.tip_patient_mm);
  Vector<Patient> displacement = from_array<Vector<Patient>>(device.velocity_patient_mm_s) *
                                 (kSolverSettings.lead_frames * kSolverFrame_s);
  if (!tip.all_finite() || !displacement.all_finite()) return std::nullopt;
  if (displacement.norm() > kSolverSettings.max_lead_mm)
    displacement = displacement.normalized() * kSolverSettings.max_lead_mm;
  if (device.contact_label[0] == 0) return project_to_surface(model, tip + displacement);
  const auto normal = from_array<Vector<Patient>>(device.normal_patient);
  const Point<Patient> position(device.contact_patient_mm[0], device.contact_patient_mm[1],
                                device.contact_patient_mm[2]);
  return project_to_surface(model, position + (displacement - normal * displacement.dot(normal)));
}

double expected_depth_mm(const DeviceTick& device, const PredictedContact& contact, double radius_mm) {
  const Vector<Patient> contact_to_tip = from_array<Point<Patient>>(device.tip_patient_mm) - contact.at;
  const double predicted_increase_mm =
      -from_array<Vector<Patient>>(device.velocity_patient_mm_s).dot(contact.outward) *
      kSolverSettings.lead_frames * kSolverFrame_s;
  const double current_depth_mm =
      presses(device) ? device.depth_mm : radius_mm - contact_to_tip.dot(contact.outward);
  return current_depth_mm + std::min(predicted_increase_mm, kSolverSettings.max_lead_mm);
}

double radius_at_depth_mm(const DeviceTick& device, double force_N, double depth_mm, double radius_mm,
                          double modulus_N_per_mm2) {
  if (!(depth_mm > 0)) return 0;
  const double hertz_mm = std::sqrt(radius_mm * depth_mm);
  if (!presses(device)) return hertz_mm;
  const double contact_radius_mm = cube_root(0.75 * force_N * radius_mm / modulus_N_per_mm2);
  return std::min(contact_radius_mm * std::sqrt(depth_mm / device.depth_mm), hertz_mm);
}

}  // namespace palpate
