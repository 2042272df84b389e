#pragma once

#include <array>

#include "palpate/contact/proxy.h"

namespace palpate {

/// Path of a proxy in one tick, recorded for collision checks: vertices with attitudes. Between vertices the
/// position is interpolated linearly and the attitude at constant angular velocity.
struct ProxyPath {
  std::array<Point<Patient>, 192> vertices;
  std::array<Eigen::Quaterniond, 192> attitudes;
  std::size_t count = 0;

  void add(const Point<Patient>& next, const Eigen::Quaterniond& turned) {
    if (count == vertices.size()) return;
    vertices[count] = next;
    attitudes[count++] = turned;
  }
};

/// advance_proxy() of palpate/contact/proxy.h that also records the path of the outermost proxy.
/// @param path  receives the path; may be null
ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options,
                          ProxyPath* path);

}  // namespace palpate
