#include "palpate/device/pointer_driver.h"

#include <array>

#include "palpate/base/clock.h"

namespace palpate {

PointerDriver::PointerDriver(const Point<Device>& tip, TimeSource now)
    : now_(now ? now : monotonic_ns), info_(info()), told_(tip) {}

DeviceInfo PointerDriver::info() {
  DeviceInfo info;
  info.name = "pointer";
  info.simulated = true;
  info.degrees_of_freedom_out = 0;
  return info;
}

void PointerDriver::move(const Point<Device>& tip) noexcept {
  told_.tell(tip, Eigen::Quaterniond::Identity(), now_());
}

void PointerDriver::release() noexcept {
  told_.let_go();
}

Result<void> PointerDriver::open(bool /*may_move*/) {
  return {};
}

void PointerDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  std::array<DeviceSample, 1> samples;
  std::array<DeviceCommand, 1> commands{};
  while (clock.wait()) {
    told_.fill(samples[0], now_());
    servo.update(samples, commands);
  }
}

}  // namespace palpate
