#include "palpate/device/pointer_driver.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "palpate/base/check.h"
#include "palpate/base/clock.h"

namespace palpate {
namespace {

// time constant with which the direction of a press follows its target, in place of steps
constexpr double kTurn_s = 0.015;
// longest interval between two ticks that counts for the control of a press
constexpr double kMaxTick_s = 0.004;

}  // namespace

PointerDriver::PointerDriver(const Point<Device>& tip, TimeSource now)
    : now_(now ? now : monotonic_ns), info_(info()), reported_(tip, kValidity_s) {}

DeviceInfo PointerDriver::info() {
  DeviceInfo info;
  info.name = "pointer";
  info.simulated = true;
  info.degrees_of_freedom_out = 0;
  return info;
}

Result<void> PointerDriver::move(const Point<Device>& tip, const Press& press, bool set_down) {
  if (!tip.all_finite())
    return Error{ErrorKind::kBadInput, "is not finite", "position", "give three finite coordinates in mm"};
  if (!press.into.all_finite() || !std::isfinite(press.force_N))
    return Error{ErrorKind::kBadInput, "is not finite", "press",
                 "give a finite direction, and a finite force in N"};
  presses_.post(press);
  reported_.push(tip, Eigen::Quaterniond::Identity(), now_(), set_down);
  return {};
}

void PointerDriver::release() noexcept {
  reported_.release();
  presses_.post({});
}

Result<void> PointerDriver::open(bool /*may_move*/) {
  commands_ = {};
  last_tick_ns_ = now_();
  return {};
}

void PointerDriver::press(DeviceSample& sample, double rendered_N, double dt_s) noexcept {
  if (presses_.take(requested_) && requested_.force_N > 0 && into_ == Vector<Device>())
    into_ = requested_.into;
  // a press that has ended leaves the surface at the same speed
  const double most_mm = kMaxPressSpeed_mm_s * dt_s;
  if (requested_.force_N > 0) {
    into_ = (into_ + (requested_.into - into_) * std::min(1.0, dt_s / kTurn_s)).normalized();
    const double by_mm = kPressGain_mm_per_N_s * (requested_.force_N - rendered_N) * dt_s;
    const double max_mm =
        rendered_N < kMinForceFraction * requested_.force_N ? kMaxSearchDepth_mm : kMaxDepth_mm;
    const double target_mm = std::clamp(depth_mm_ + by_mm, kMinDepth_mm, max_mm);
    depth_mm_ += std::clamp(target_mm - depth_mm_, -most_mm, most_mm);
  } else {
    depth_mm_ -= std::clamp(depth_mm_, -most_mm, most_mm);
    if (depth_mm_ == 0) into_ = {};
  }
  sample.tip = sample.tip + into_ * depth_mm_;
}

void PointerDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  std::array<DeviceSample, 1> samples;
  while (clock.wait()) {
    const std::int64_t now_ns = now_();
    reported_.fill(samples[0], now_ns);
    if (samples[0].set_down) depth_mm_ = 0;
    press(samples[0], commands_[0].force_N.norm(),
          std::min(static_cast<double>(now_ns - last_tick_ns_) * 1e-9, kMaxTick_s));
    last_tick_ns_ = now_ns;
    servo.update(samples, commands_);
  }
}

}  // namespace palpate
