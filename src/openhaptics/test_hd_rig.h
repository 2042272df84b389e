#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cmath>
#include <memory>
#include <string>
#include <thread>

#include "base/test_wait.h"
#include "device/test_wall.h"
#include "openhaptics/test_fake_hd.h"
#include "palpate/openhaptics/openhaptics_driver.h"

namespace palpate::testing {

/// The stand-in in a file, as the driver will find it there; as at the beginning.
inline FakeHd& fake_hd(const char* file = PALPATE_FAKE_HD) {
  void* const library = ::dlopen(file, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << ::dlerror();
  FakeHd& fake = *reinterpret_cast<FakeHdFunction>(::dlsym(library, kFakeHdFunction))();
  fake.reset();
  return fake;
}

inline OpenHapticsSettings fake_hd_settings(const char* file = PALPATE_FAKE_HD) {
  OpenHapticsSettings settings;
  settings.library.file = file;
  return settings;
}

/// A driver that runs with the stand-in, its first device pressing the wall.
class HdRig {
 public:
  explicit HdRig(bool begins = true, const OpenHapticsSettings& settings = fake_hd_settings())
      : fake(fake_hd()), device(fake.device[0]), driver(std::make_unique<OpenHapticsDriver>(settings)) {
    if (!begins) return;
    const auto opened = driver->open(false);
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message());
    if (opened) begin();
  }
  ~HdRig() { end(); }
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
             return std::abs(wall.tip_x_mm - kWallPressed_mm) < 0.02 && device.force_N > 0.5 && !wall.fault;
           });
  }
  bool says(const char* words) {
    return soon([&] {
      const auto trouble = driver->trouble();
      return trouble && trouble->what.find(words) != std::string::npos && !trouble->remedy.empty();
    });
  }

  FakeHd& fake;
  FakeHdDevice& device;
  std::unique_ptr<OpenHapticsDriver> driver;
  GuardedWall wall;
  UntilStopped clock;

 private:
  std::thread thread_;
};

}  // namespace palpate::testing
