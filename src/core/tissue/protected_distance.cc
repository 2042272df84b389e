#include "palpate/tissue/protected_distance.h"

#include <algorithm>

#include "palpate/contact/recorded_pose.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/swept_voxels.h"

namespace palpate {

bool motor_was_on(const Model& model, const TickRecord& tick) {
  const bool switched_on = (tick.switches & kSwitchMotor) != 0;
  for (std::size_t d = 0; d < static_cast<std::size_t>(tick.devices); ++d)
    if (model.tool_of(d).motor_is_on(switched_on, tick.device[d].buttons)) return true;
  return false;
}

ProtectedDistanceMeter::ProtectedDistanceMeter(const Model& model)
    : X_WorldPatient_(model.X_WorldPatient), protected_(model.protected_structures) {
  for (std::size_t d = 0; d < kMaxDevices; ++d) tools_[d] = model.tool_of(d);
}

void ProtectedDistanceMeter::observe(const TickRecord& tick) {
  if (protected_.empty()) return;
  const bool switched_on = (tick.switches & kSwitchMotor) != 0;
  // without force the motor stands still, and without a proxy the burr's position is unknown
  constexpr std::uint32_t kStill = kFaultFlags | kFlagPaused | kFlagClutched | kFlagRamp | kFlagInside;
  for (std::size_t d = 0; d < static_cast<std::size_t>(tick.devices); ++d) {
    const DeviceTick& device = tick.device[d];
    const Tool& tool = tools_[d];
    if (!tool.motor_is_on(switched_on, device.buttons)) continue;
    if ((device.flags & kStill) != 0 || device.age_s >= kCuttingSettings.motor_timeout_s) continue;
    const Point<Patient> at(device.proxy_patient_mm[0], device.proxy_patient_mm[1],
                            device.proxy_patient_mm[2]);
    const Sweep head{at, at, tool.radius_mm, 0, row_mm(*tool.burr, tick, device), tool.burr->end_radius_mm};
    if (head.is_of_ball())
      for (const ProtectedStructure& structure : protected_) observe(at, tool.radius_mm, structure);
    else
      observe(head);
  }
}

// vector along the head's row of balls, in the object's frame at its current rotation
Vector<Patient> ProtectedDistanceMeter::row_mm(const BurrSettings& burr, const TickRecord& tick,
                                               const DeviceTick& device) const {
  if (!(burr.length_mm > 0)) return {};
  return tool_in_patient(X_WorldPatient_, tick, device, burr.spindle * burr.length_mm);
}

void ProtectedDistanceMeter::observe(const Sweep& sweep) {
  for (const ProtectedStructure& structure : protected_)
    for_balls_of(sweep, structure.surface->distance_field().geometry().min_spacing_mm(),
                 [&](const Point<Patient>& at, double radius_mm) { observe(at, radius_mm, structure); });
}

void ProtectedDistanceMeter::observe(const std::map<LabelId, double>& nearest_mm) {
  for (const auto& [label, mm] : nearest_mm) {
    const auto [known, is_new] = nearest_mm_.try_emplace(label, mm);
    if (!is_new) known->second = std::min(known->second, mm);
  }
}

void ProtectedDistanceMeter::observe(const Point<Patient>& at, double radius_mm,
                                     const ProtectedStructure& structure) {
  const double distance_mm = structure.surface->distance_mm(at);
  if (distance_mm >= structure.surface->outside_mm()) return;
  const double gap_mm = std::max(0.0, distance_mm - radius_mm);
  const auto [known, is_new] = nearest_mm_.try_emplace(structure.label, gap_mm);
  if (!is_new) known->second = std::min(known->second, gap_mm);
}

}  // namespace palpate
