#pragma once

#include <optional>
#include <span>

#include "palpate/contact/proxy.h"

namespace palpate {

/// Tool parts in a proxy's attitude. Without a copy in the common case that it equals the operator's.
class ProxyParts {
 public:
  /// @param parts  tool parts in the operator's attitude; must outlive this object
  ProxyParts(std::span<const ToolPart> parts, const Eigen::Quaterniond& tool_pose,
             const Eigen::Quaterniond& proxy)
      : original_(parts) {
    if (proxy.coeffs() != tool_pose.coeffs()) turned_.emplace(parts, tool_pose, proxy);
  }
  std::span<const ToolPart> parts() const { return turned_ ? turned_->parts() : original_; }

 private:
  std::span<const ToolPart> original_;
  std::optional<RotatedTool> turned_;
};

}  // namespace palpate
