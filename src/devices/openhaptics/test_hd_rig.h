#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "device/test_driver_rig.h"
#include "openhaptics/test_fake_hd.h"
#include "palpate/openhaptics/openhaptics_driver.h"

namespace palpate::testing {

/// Loads the fake library that the driver will find in this file, and resets it.
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

struct HdSide {
  FakeHd& fake = fake_hd();
  FakeHdDevice& device = fake.device[0];
};

/// A driver connected to the fake library.
class HdRig : public HdSide, public DriverRig<OpenHapticsDriver> {
 public:
  explicit HdRig(bool begins = true, const OpenHapticsSettings& settings = fake_hd_settings())
      : DriverRig(std::make_unique<OpenHapticsDriver>(settings), [this] { return device.force_N.load(); }) {
    if (begins) open_and_begin();
  }
};

using HdFault = DriverFault<FakeHd>;

inline const std::vector<HdFault>& hd_faults() {
  const auto flag = [](const char* name, std::atomic<bool> FakeHdDevice::*member, bool faulty,
                       const char* words) {
    return HdFault{name, [=](FakeHd& fake) { fake.device[0].*member = faulty; },
                   [=](FakeHd& fake) { fake.device[0].*member = !faulty; }, words};
  };
  const auto error = [](const char* name, unsigned code, const char* words) {
    return HdFault{name, [=](FakeHd& fake) { fake.device[0].error = code; }, [](FakeHd&) {}, words};
  };
  static const std::vector<HdFault> faults{
      flag("unplugged", &FakeHdDevice::plugged, false, "has lost the device"),
      flag("communication", &FakeHdDevice::communication, false, "has lost the device"),
      flag("nowhere", &FakeHdDevice::nowhere, true, "an invalid position"),
      flag("crooked", &FakeHdDevice::crooked, true, "an invalid position"),
      flag("mute", &FakeHdDevice::mute, true, "an invalid position"),
      flag("calibration", &FakeHdDevice::never_calibrates, true, "not calibrated"),
      error("warm", 0x200, "motors are warm"),
      error("force", 0x201, "force was too high"),
      error("impulse", 0x202, "force was too high"),
      error("velocity", 0x203, "exceeded its speed limit"),
      error("forceError", 0x204, "force was too high"),
      error("deviceFault", 0x300, "has lost the device"),
      error("timer", 0x304, "has lost the device"),
      {"slow and lost",
       [](FakeHd& fake) {
         fake.hangs = true;
         std::this_thread::sleep_for(std::chrono::milliseconds(20));
         fake.device[0].error = 0x300;
         fake.hangs = false;
       },
       [](FakeHd&) {}, "has lost the device"},
      {"stalled", [](FakeHd& fake) { fake.stalled = true; }, [](FakeHd& fake) { fake.stalled = false; },
       "has stalled"},
  };
  return faults;
}

/// Also a frame that hangs in the library, where the end of a session leaves it.
inline const std::vector<HdFault>& hd_faults_and_hang() {
  static const std::vector<HdFault> faults = [] {
    std::vector<HdFault> all = hd_faults();
    all.push_back({"hanging", [](FakeHd& fake) { fake.hangs = true; },
                   [](FakeHd& fake) { fake.hangs = false; }, "has stalled"});
    return all;
  }();
  return faults;
}

}  // namespace palpate::testing
