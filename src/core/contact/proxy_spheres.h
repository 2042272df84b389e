#pragma once

#include <optional>
#include <span>

#include "palpate/contact/proxy.h"

namespace palpate {

/// Tool parts in a proxy's attitude. Without a copy in the common case that it equals the operator's.
class ProxySpheres {
 public:
  /// @param spheres  tool parts in the operator's attitude; must outlive this object
  ProxySpheres(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& hand,
               const Eigen::Quaterniond& proxy)
      : as_in_hand_(spheres) {
    if (proxy.coeffs() != hand.coeffs()) turned_.emplace(spheres, hand, proxy);
  }
  std::span<const ToolSphere> spheres() const { return turned_ ? turned_->spheres() : as_in_hand_; }

 private:
  std::span<const ToolSphere> as_in_hand_;
  std::optional<RotatedTool> turned_;
};

}  // namespace palpate
