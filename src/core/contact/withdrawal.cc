#include "contact/withdrawal.h"

#include <algorithm>
#include <limits>

#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"

namespace palpate {
namespace {

// Whether the tool is clear of the outermost layer and has a collision-free straight path to another pose
// (linear tip motion, spherical interpolation of the attitude). Sphere tracing (Hart 1996); false if that
// exceeds the work limit of a tick.
bool is_path_free(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                  const SurfaceSet& punctured, const ToolPose& tool_pose, const ToolPose& to) {
  const Vector<Patient> displacement_mm = to.tip - tool_pose.tip;
  const double arc_mm = arc_of_rotation_mm(parts, tool_pose.attitude, to.attitude);
  const double length_mm = displacement_mm.norm() + arc_mm,
               reach_mm = std::max(length_mm, kProxySettings.withdrawal_clearance_mm);
  PairSet pairs(surfaces, parts, 0, punctured, tool_pose.tip, reach_mm);
  if (pairs.reach_mm() < reach_mm) return false;
  const auto clearance_mm = [&](const Point<Patient>& at) {
    double min_mm = std::numeric_limits<double>::infinity();
    for (std::size_t n = 0; n < pairs.count(); ++n) min_mm = std::min(min_mm, pairs.clearance(n, at));
    return min_mm;
  };
  double free_mm = clearance_mm(tool_pose.tip);
  if (free_mm < kProxySettings.withdrawal_clearance_mm) return false;
  double traced_mm = 0;
  for (int sample = 0; sample < kProxySettings.max_withdrawal_samples; ++sample) {
    if (!(free_mm + kProxySettings.substep_penetration_mm > 0)) return false;
    traced_mm += (free_mm + kProxySettings.substep_penetration_mm) / pairs.max_gradient();
    if (traced_mm >= length_mm) return true;
    const double fraction = traced_mm / length_mm;
    if (arc_mm > 0)
      pairs.turn(
          RotatedTool(parts, tool_pose.attitude, tool_pose.attitude.slerp(fraction, to.attitude)).parts());
    free_mm = clearance_mm(tool_pose.tip + displacement_mm * fraction);
  }
  return false;
}

}  // namespace

bool has_withdrawn(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                   const ToolPose& tool_pose, ProxyState& state) {
  if (state.contact_count == 0 ||
      (tool_pose.tip - state.last_search_tip).norm() < kProxySettings.withdrawal_pitch_mm)
    return false;
  state.last_search_tip = tool_pose.tip;
  // early-out: the tip usually lies below the surface in contact
  const ProxyContact& contact = state.contacts[0];
  const ToolPart& part = parts[static_cast<std::size_t>(contact.part)];
  const Surface& surface = *surfaces[static_cast<std::size_t>(contact.surface)].surface;
  const double cutoff_mm = part.radius_mm + kProxySettings.withdrawal_clearance_mm;
  if (nearest_part(surface, part, tool_pose.tip, cutoff_mm).distance_mm < cutoff_mm) return false;
  return is_path_free(surfaces, parts, state.punctured, tool_pose, {state.free_tip, state.free_attitude});
}

}  // namespace palpate
