#pragma once

#include <algorithm>
#include <array>

#include "palpate/tissue/removal.h"

/// Pose and displacement of a burr's head in the patient's frame, per layer of the proxy.
namespace palpate {

/// Pose of the burr's head as constrained by one layer.
struct HeadPose {
  Point<Patient> at;
  Eigen::Quaterniond attitude;
};

/// A burr at the hand's attitude, and at those of the layers' proxies.
class BurrTool {
 public:
  BurrTool(const Burr& burr, const ToolPose& tool_pose)
      : burr_(burr), hand_(tool_pose), head_(burr.head(0)) {}

  const Burr& operator*() const { return burr_; }
  const Burr* operator->() const { return &burr_; }
  bool is_ball() const { return !(burr_.length_mm > 0); }
  ToolPart head(const Eigen::Quaterniond& attitude) const {
    return RotatedTool({&head_, 1}, hand_.attitude, attitude).parts()[0];
  }
  /// Unit vector of its spindle.
  Vector<Patient> spindle(const ToolPart& head) const {
    return is_ball() ? burr_.axis : head.axis_mm / burr_.length_mm;
  }
  /// Pose interpolated between two poses. A ball always has the final attitude.
  HeadPose interpolate(const HeadPose& from, const HeadPose& to, double fraction) const {
    const bool turns = !is_ball() && fraction < 1 && from.attitude.coeffs() != to.attitude.coeffs();
    return {from.at + (to.at - from.at) * fraction,
            turns ? from.attitude.slerp(fraction, to.attitude) : to.attitude};
  }

 private:
  const Burr& burr_;
  const ToolPose& hand_;
  ToolPart head_;
};

/// Displacements of both ends of a head's axis.
struct HeadDisplacement {
  double length_mm = 0;                  // displacement of the end that moves farther
  std::array<Vector<Patient>, 2> along;  // unit vectors
  std::array<double, 2> fraction{};      // fraction of length_mm

  HeadDisplacement(const Vector<Patient>& first, const Vector<Patient>& last) {
    const std::array paths{first, last};
    const std::array lengths{first.norm(), last.norm()};
    length_mm = std::max(lengths[0], lengths[1]);
    for (std::size_t end = 0; end < 2; ++end) {
      if (!(lengths[end] > 0)) continue;
      along[end] = paths[end] / lengths[end];
      fraction[end] = lengths[end] / length_mm;
    }
  }
};

}  // namespace palpate
