#pragma once

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "base/test_wait.h"
#include "device/test_wall.h"
#include "haply/test_haply_service.h"
#include "palpate/base/clock.h"

namespace palpate::testing {

// where the hand and the wall of every driver's tests are (device/test_wall.h)
inline constexpr double kHaplyHand_N_per_mm = kWallHand_N_per_mm, kHaplyWall_N_per_mm = kWall_N_per_mm,
                        kHaplyIntended_mm = kWallIntended_mm, kHaplyPressed_mm = kWallPressed_mm;

inline SimulatedDevice haply_hand(const Point<Device>& tip = Point<Device>(kHaplyIntended_mm, 0, 0)) {
  return wall_hand(tip);
}

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
