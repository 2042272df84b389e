#pragma once

#include <optional>
#include <span>

#include "palpate/contact/proxy.h"

namespace palpate {

/// Tool parts in a proxy's attitude. Without a copy in the common case that it equals the operator's.
class ProxySpheres {
 public:
  /// @param spheres  tool parts in the operator's attitude; must outlive this object
  ProxySpheres(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& tool_pose,
               const Eigen::Quaterniond& proxy)
      : original_(spheres) {
    if (proxy.coeffs() != tool_pose.coeffs()) turned_.emplace(spheres, tool_pose, proxy);
  }
  std::span<const ToolSphere> spheres() const { return turned_ ? turned_->spheres() : original_; }

 private:
  std::span<const ToolSphere> original_;
  std::optional<RotatedTool> turned_;
};

}  // namespace palpate
