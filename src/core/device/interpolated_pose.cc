#include "palpate/device/interpolated_pose.h"

#include <algorithm>
#include <cmath>

namespace palpate {
namespace {

// interval between updates: 4 ms for a page that redraws 250 times a second, 33 ms at rest
constexpr std::int64_t kMinInterval_ns = 4'000'000, kMaxInterval_ns = 40'000'000;

}  // namespace

void InterpolatedPose::push(const Point<Device>& tip, const Eigen::Quaterniond& R_DeviceTool,
                            std::int64_t at_ns, bool set_down) noexcept {
  PALPATE_CHECK(tip.all_finite() && R_DeviceTool.coeffs().allFinite());
  if (set_down) ++set_downs_;
  messages_.post({{tip, R_DeviceTool}, at_ns, true, set_downs_});
}

void InterpolatedPose::release() noexcept {
  messages_.post({{}, 0, false, set_downs_});
}

InterpolatedPose::Pose InterpolatedPose::pose_at(std::int64_t now_ns) const noexcept {
  if (now_ns >= to_ns_) return to_;
  const double part = static_cast<double>(now_ns - from_ns_) / static_cast<double>(to_ns_ - from_ns_);
  return {from_.tip + (to_.tip - from_.tip) * part, from_.R_DeviceTool.slerp(part, to_.R_DeviceTool)};
}

// Starts a new interpolation at the current position, over the expected time to the next update. A pose that
// returns after an interruption applies at once: its path is unknown, and interpolating would drag a contact
// along it.
bool InterpolatedPose::read_message(std::int64_t now_ns) noexcept {
  Message message;
  if (!messages_.take(message)) return false;
  const bool is_set_down = message.is_valid && message.set_downs != last_.set_downs;
  const bool comes_back =
      message.is_valid && !(last_.is_valid && message.at_ns - last_.at_ns <= validity_ns_);
  from_ = comes_back || is_set_down ? message.pose : pose_at(now_ns);
  from_ns_ = now_ns;
  to_ = message.is_valid ? message.pose : from_;
  const std::int64_t interval_ns = std::clamp(message.at_ns - last_.at_ns, kMinInterval_ns, kMaxInterval_ns);
  const double path_ns = (to_.tip - from_.tip).norm() / kMaxSpeed_mm_s * 1e9;
  to_ns_ = now_ns + std::max(interval_ns, static_cast<std::int64_t>(std::min(path_ns, 1e18)));
  last_ = message;
  return is_set_down;
}

void InterpolatedPose::fill(DeviceSample& sample, std::int64_t now_ns) noexcept {
  sample.set_down = read_message(now_ns);
  const Pose pose = pose_at(now_ns);
  sample.tip = pose.tip;
  sample.R_DeviceTool = pose.R_DeviceTool;
  sample.taken_ns = last_.is_valid ? std::min(now_ns, last_.at_ns + validity_ns_) : 0;
}

}  // namespace palpate
