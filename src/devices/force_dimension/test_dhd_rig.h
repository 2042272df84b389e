#pragma once

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <memory>
#include <vector>

#include "device/test_driver_rig.h"
#include "force_dimension/test_fake_dhd.h"
#include "palpate/force_dimension/force_dimension_driver.h"

namespace palpate::testing {

/// Loads the fake library that the driver will find in this file, and resets it.
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

struct DhdSide {
  FakeDhd& fake = fake_dhd();
  FakeDhdDevice& device = fake.device[0];
};

/// A driver connected to the fake library.
class DhdRig : public DhdSide, public DriverRig<ForceDimensionDriver> {
 public:
  explicit DhdRig(int type = 33, bool begins = true)
      : DriverRig(std::make_unique<ForceDimensionDriver>(fake_dhd_settings()),
                  [this] { return device.force_N.load(); }) {
    device.type = type;
    if (begins) open_and_begin();
  }
};

using DhdFault = DriverFault<FakeDhdDevice>;

inline const std::vector<DhdFault>& dhd_faults() {
  const auto trip = [](const char* name, int cause, const char* words) {
    return DhdFault{name, [=](FakeDhdDevice& device) { device.trip = cause; },
                    [](FakeDhdDevice& device) { device.restored = true; }, words};
  };
  static const std::vector<DhdFault> faults{
      flag_fault("unplugged", &FakeDhdDevice::plugged, false, "disconnected"),
      flag_fault("failing", &FakeDhdDevice::fails, true, "cannot be opened"),
      flag_fault("mute", &FakeDhdDevice::mute, true, "does not answer"),
      flag_fault("deaf", &FakeDhdDevice::deaf, true, "does not answer"),
      flag_fault("power", &FakeDhdDevice::power, false, "no power"),
      flag_fault("calibration", &FakeDhdDevice::initialised, false, "not initialised"),
      flag_fault("error", &FakeDhdDevice::error, true, "reports an error"),
      flag_fault("nowhere", &FakeDhdDevice::nowhere, true, "an invalid position"),
      flag_fault("crooked", &FakeDhdDevice::crooked, true, "an invalid position"),
      trip("button", 1, "disabled at the device"),
      trip("velocity", 2, "exceeded its speed limit"),
      trip("watchdog", 3, "received no commands"),
      trip("usb", 5, "USB"),
      trip("deadman", 6, "is not held"),
      {"replugged uninitialised",
       [](FakeDhdDevice& device) {
         device.plugged = false;
         device.initialised = false;
       },
       [](FakeDhdDevice& device) {
         device.plugged = true;
         device.initialised = true;
       },
       "disconnected"},
  };
  return faults;
}

}  // namespace palpate::testing
