#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "base/test_wait.h"
#include "haply/test_haply_service.h"
#include "palpate/base/clock.h"

namespace palpate::testing {

// a hand and device that come to rest within 20 ms: critically damped, 316 rad/s
inline constexpr double kHaplyHand_N_per_mm = 2, kHaplyWall_N_per_mm = 1, kHaplyIntended_mm = 1.2;

inline SimulatedDevice haply_hand(const Point<Device>& tip = Point<Device>(kHaplyIntended_mm, 0, 0)) {
  SimulatedDevice device({"light", 0.01, 0, 0, 0, 1e9, 1e9},
                         {"still", 0.01, 12.6, kHaplyHand_N_per_mm * 1000});
  device.reset(tip);
  return device;
}
// where the tip rests, the hand wanting it kHaplyIntended_mm behind the wall
inline constexpr double kHaplyPressed_mm =
    kHaplyIntended_mm * kHaplyHand_N_per_mm / (kHaplyHand_N_per_mm + kHaplyWall_N_per_mm);

/// A wall that begins at x = 0, as an output stage guards it: no force for a fault or a state older than 10
/// ms.
class GuardedWall final : public ServoFunction {
 public:
  void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
    const DeviceSample& sample = samples[0];
    const bool old = monotonic_ns() - sample.taken_ns > 10'000'000;
    commands[0] = {};
    if (!old && !sample.fault)
      commands[0].force_N = Vector<Device>(-kHaplyWall_N_per_mm * std::max(0.0, sample.tip.x()), 0, 0);
    fault = sample.fault;
    tip_x_mm = sample.tip.x();
    if (sample.taken_ns != taken_ns) ++samples_taken;
    taken_ns = sample.taken_ns;
    ++updates;
  }
  std::atomic<bool> fault{false};
  std::atomic<double> tip_x_mm{0};
  std::atomic<std::int64_t> taken_ns{0};
  std::atomic<int> updates{0}, samples_taken{0};
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

/// A driver that runs against a service, pressing the wall.
class HaplyRig {
 public:
  explicit HaplyRig(const std::string& version = "3.1.1", bool begins = true)
      : service(haply_hand(), version), driver(std::make_unique<HaplyDriver>(service.settings())) {
    if (!begins) return;
    const auto opened = driver->open(false);
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message());
    if (opened) begin();
  }
  ~HaplyRig() { end(); }
  void begin() {
    clock.stop = false;
    thread_ = std::thread([this] { driver->run(wall, clock); });
  }
  void end() {
    clock.stop = true;
    if (thread_.joinable()) thread_.join();
  }
  bool presses() {
    return thread_.joinable() && soon([&] {
             return std::abs(wall.tip_x_mm - kHaplyPressed_mm) < 0.02 && service.force_N() > 0.5 &&
                    !wall.fault;
           });
  }
  bool says(const char* words) {
    return soon([&] {
      const auto trouble = driver->trouble();
      return trouble && trouble->what.find(words) != std::string::npos && !trouble->remedy.empty();
    });
  }

  FakeInverseService service;
  std::unique_ptr<HaplyDriver> driver;
  GuardedWall wall;
  UntilStopped clock;

 private:
  std::thread thread_;
};

}  // namespace palpate::testing
