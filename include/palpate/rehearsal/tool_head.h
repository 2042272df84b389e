#pragma once

#include <algorithm>
#include <optional>

#include "palpate/contact/recorded_pose.h"
#include "palpate/rehearsal/structure_distance.h"

namespace palpate {

/// Row of balls at a tool's tip, in the patient frame; a single ball if both ends coincide.
struct ToolHead {
  Point<Patient> from, to;
  double radius_mm = 0, end_radius_mm = 0;

  /// Upper bound of the change of its clearance to anything from another pose of the same head.
  double moved_mm(const ToolHead& other) const {
    return std::max((from - other.from).norm(), (to - other.to).norm());
  }
};

/// Position of the tool's tip, as defined in palpate/rehearsal/comparison.h.
inline Point<Patient> tip_of(const Tool& tool, const DeviceTick& device) {
  const auto& at = tool.burr ? device.proxy_patient_mm : device.tip_patient_mm;
  return {at[0], at[1], at[2]};
}

inline ToolHead head_of(const Transform<World, Patient>& X_WorldPatient, const Tool& tool,
                        const TickRecord& tick, const DeviceTick& device) {
  const Point<Patient> tip = tip_of(tool, device);
  const bool has_ball = std::any_of(tool.points_mm.begin(), tool.points_mm.end(),
                                    [](const Eigen::Vector3d& point) { return point.norm() < 1e-9; });
  ToolHead head{tip, tip, has_ball ? tool.radius_mm : 0, has_ball ? tool.radius_mm : 0};
  if (tool.burr && tool.burr->length_mm > 0) {
    head.to = tip + tool_in_patient(X_WorldPatient, tick, device, tool.burr->spindle * tool.burr->length_mm);
    head.end_radius_mm = tool.burr->end_radius_mm;
  }
  return head;
}

/// Direction from a tool's tip to its handle, in the tool frame; unit. Empty for tools without a shaft.
inline std::optional<Eigen::Vector3d> shaft_of(const Tool& tool) {
  if (tool.burr) return tool.burr->spindle.normalized();
  const ToolCapsule* longest = nullptr;
  for (const ToolCapsule& capsule : tool.capsules)
    if (longest == nullptr ||
        (capsule.to_mm - capsule.from_mm).norm() > (longest->to_mm - longest->from_mm).norm())
      longest = &capsule;
  if (longest == nullptr) return std::nullopt;
  const Eigen::Vector3d along = (longest->to_mm - longest->from_mm).normalized();
  return longest->to_mm.norm() >= longest->from_mm.norm() ? along : Eigen::Vector3d(-along);
}

/// Clearance from the head's surface to a structure's surface, mm; negative inside.
inline double gap_mm(const StructureDistance& structure, const ToolHead& head) {
  // along the row the clearance decreases by at most twice the distance, which allows longer steps
  constexpr double kSeparation_mm = 0.25;
  const Vector<Patient> row = head.to - head.from;
  const double length_mm = row.norm();
  double min_mm = structure.distance_mm(head.from) - head.radius_mm;
  if (length_mm == 0) return min_mm;
  double gap = min_mm, along_mm = 0;
  while (along_mm < length_mm) {
    along_mm = std::min(length_mm, along_mm + std::max(kSeparation_mm, 0.5 * (gap - min_mm)));
    const double part = along_mm / length_mm;
    gap = structure.distance_mm(head.from + row * part) - head.radius_mm -
          (head.end_radius_mm - head.radius_mm) * part;
    min_mm = std::min(min_mm, gap);
  }
  return min_mm;
}

}  // namespace palpate
