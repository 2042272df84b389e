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
#include "force_dimension/test_fake_dhd.h"
#include "palpate/force_dimension/force_dimension_driver.h"

namespace palpate::testing {

/// The stand-in in a file, as the driver will find it there; as at the beginning.
inline FakeDhd& fake_dhd(const char* file = PALPATE_FAKE_DRD) {
  void* const library = ::dlopen(file, RTLD_NOW | RTLD_LOCAL);
  EXPECT_NE(library, nullptr) << ::dlerror();
  FakeDhd& fake = *reinterpret_cast<FakeDhdFunction>(::dlsym(library, kFakeDhdFunction))();
  fake.reset();
  return fake;
}

inline ForceDimensionSettings fake_dhd_settings(const char* file = PALPATE_FAKE_DRD) {
  ForceDimensionSettings settings;
  settings.library.file = file;
  return settings;
}

/// A driver that runs with the stand-in, its first device pressing the wall.
class DhdRig {
 public:
  explicit DhdRig(int type = 33, bool begins = true)
      : fake(fake_dhd()),
        device(fake.device[0]),
        driver(std::make_unique<ForceDimensionDriver>(fake_dhd_settings())) {
    device.type = type;
    if (!begins) return;
    const auto opened = driver->open(false);
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message());
    if (opened) begin();
  }
  ~DhdRig() { end(); }
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

  FakeDhd& fake;
  FakeDhdDevice& device;
  std::unique_ptr<ForceDimensionDriver> driver;
  GuardedWall wall;
  UntilStopped clock;

 private:
  std::thread thread_;
};

}  // namespace palpate::testing
