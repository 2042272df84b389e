#include <algorithm>
#include <array>

#include "palpate/base/clock.h"
#include "palpate/base/mailbox.h"
#include "palpate/device/simulated_device.h"

namespace palpate {

SimulatedDriver::SimulatedDriver(const SimulatedDevice& device, TimeSource now)
    : now_(now ? now : monotonic_ns),
      device_(device),
      info_(device.info()),
      intentions_(std::make_unique<Mailbox<Intention>>()),
      from_(device.intention()),
      to_{device.intention(), 0} {}

SimulatedDriver::~SimulatedDriver() = default;

void SimulatedDriver::intend(const Point<Device>& target, std::int64_t at_ns) noexcept {
  PALPATE_CHECK(target.all_finite());
  intentions_->post({target, at_ns});
}

Result<void> SimulatedDriver::open(bool /*may_move*/) {
  return {};
}

const SimulatedDevice& SimulatedDriver::device() const {
  PALPATE_CHECK(!running_);
  return device_;
}

// updates the intended position; a new target starts from the current one
void SimulatedDriver::lead_hand(std::int64_t now_ns) {
  if (intentions_->take(to_)) {
    from_ = device_.intention();
    from_ns_ = last_ns_;
  }
  const bool there = now_ns >= to_.at_ns || from_ns_ >= to_.at_ns;
  const double part =
      there ? 1 : static_cast<double>(now_ns - from_ns_) / static_cast<double>(to_.at_ns - from_ns_);
  device_.intend(there ? to_.target : from_ + (to_.target - from_) * part);
}

void SimulatedDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  running_ = true;
  std::array<DeviceSample, 1> samples;
  std::array<DeviceCommand, 1> commands{};
  last_ns_ = now_();
  while (clock.wait()) {
    // advance the simulation to the current time under the last command
    const std::int64_t now_ns = now_();
    lead_hand(now_ns);
    const double passed_s = std::min(static_cast<double>(now_ns - last_ns_) * 1e-9, kMaxAdvance_s);
    if (passed_s > 0) device_.advance(halted_ ? DeviceCommand{} : commands[0], passed_s);
    last_ns_ = now_ns;

    samples[0] = device_.read();
    samples[0].taken_ns = now_ns;
    servo.update(samples, commands);
  }
  running_ = false;
}

}  // namespace palpate
