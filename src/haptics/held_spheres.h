#pragma once

#include <optional>
#include <span>

#include "palpate/haptics/proxy.h"

namespace palpate {

/// A tool's spheres as a proxy holds them: mostly as the hand does, and then they are not copied.
class HeldSpheres {
 public:
  /// @param spheres  as the hand's attitude turns them; they outlive this
  HeldSpheres(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& hand,
              const Eigen::Quaterniond& proxy)
      : as_in_hand_(spheres) {
    if (proxy.coeffs() != hand.coeffs()) turned_.emplace(spheres, hand, proxy);
  }
  std::span<const ToolSphere> spheres() const { return turned_ ? turned_->spheres() : as_in_hand_; }

 private:
  std::span<const ToolSphere> as_in_hand_;
  std::optional<TurnedTool> turned_;
};

}  // namespace palpate
