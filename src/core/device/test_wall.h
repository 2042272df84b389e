#pragma once

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <span>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/device/device.h"
#include "palpate/device/simulated_device.h"

/// Test scene for vendors' drivers: a hand that presses against a wall.
namespace palpate::testing {

inline constexpr double kWallHand_N_per_mm = 2, kWall_N_per_mm = 1, kWallIntended_mm = 1.2;
// rest position of the tip when the hand aims kWallIntended_mm behind the surface
inline constexpr double kWallPressed_mm =
    kWallIntended_mm * kWallHand_N_per_mm / (kWallHand_N_per_mm + kWall_N_per_mm);

// a hand and device that settle within 20 ms: critically damped, 316 rad/s
inline SimulatedDevice wall_hand(const Point<Device>& tip) {
  SimulatedDevice device({"light", 0.01, 0, 0, 0, 1e9, 1e9},
                         {"still", 0.01, 12.6, kWallHand_N_per_mm * 1000});
  device.reset(tip);
  return device;
}

/// Wall at x = 0, guarded like the output stage: no force for a fault or a state older than 10 ms.
class GuardedWall final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    if (inside_.exchange(true)) twice_at_once = true;
    const DeviceSample& sample = samples[0];
    const bool old = monotonic_ns() - sample.taken_ns > 10'000'000;
    for (DeviceCommand& command : commands) command = {};
    if (!old && !sample.fault)
      commands[0].force_N = Vector<Device>(-kWall_N_per_mm * std::max(0.0, sample.tip.x()), 0, 0);
    fault = sample.fault;
    tip_x_mm = sample.tip.x();
    if (sample.taken_ns != taken_ns) ++samples_taken;
    taken_ns = sample.taken_ns;
    ++updates;
    inside_ = false;
  }
  std::atomic<bool> fault{false};
  std::atomic<bool> twice_at_once{false};  ///< Called while a call was active
  std::atomic<double> tip_x_mm{0};
  std::atomic<std::int64_t> taken_ns{0};
  std::atomic<int> updates{0}, samples_taken{0};

 private:
  std::atomic<bool> inside_{false};
};

class UntilStopped final : public ServoClock {
 public:
  bool wait() noexcept override {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    return !stop;
  }
  bool stopped() const noexcept override { return stop; }
  std::atomic<bool> stop{false};
};

}  // namespace palpate::testing
