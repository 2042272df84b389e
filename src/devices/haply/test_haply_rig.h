#pragma once

#include <memory>
#include <string>
#include <vector>

#include "device/test_driver_rig.h"
#include "haply/test_haply_service.h"

namespace palpate::testing {

inline SimulatedDevice haply_hand(const Point<Device>& tip = Point<Device>(kWallIntended_mm, 0, 0)) {
  return wall_hand(tip);
}

struct HaplySide {
  explicit HaplySide(const std::string& version) : service(haply_hand(), version) {}
  FakeInverseService service;
};

/// A driver connected to a fake service.
class HaplyRig : public HaplySide, public DriverRig<HaplyDriver> {
 public:
  explicit HaplyRig(const std::string& version = "3.1.1", bool begins = true)
      : HaplySide(version),
        DriverRig(std::make_unique<HaplyDriver>(service.settings()), [this] { return service.force_N(); }) {
    if (begins) open_and_begin();
  }
};

using HaplyFault = DriverFault<FakeInverseService>;

inline const std::vector<HaplyFault>& haply_faults() {
  static const std::vector<HaplyFault> faults{
      flag_fault("silent", &FakeInverseService::silent, true, "sends no states"),
      flag_fault("deaf", &FakeInverseService::deaf, true, "sends no states"),
      flag_fault("broken", &FakeInverseService::breaks_json, true, "not device states"),
      flag_fault("other", &FakeInverseService::says_other, true, "not device states"),
      flag_fault("place", &FakeInverseService::odd_position, true, "not device states"),
      flag_fault("calibration", &FakeInverseService::calibrated, false, "not calibrated"),
      flag_fault("power", &FakeInverseService::power, false, "no power"),
      flag_fault("ready", &FakeInverseService::ready, false, "not ready"),
      flag_fault("gone", &FakeInverseService::present, false, "lost the device"),
      {"killed", [](FakeInverseService& service) { service.stop(); },
       [](FakeInverseService& service) { service.start("3.1.1"); }, "does not answer", true},
      {"updated", [](FakeInverseService& service) { service.stop(); },
       [](FakeInverseService& service) { service.start("3.5.0"); }, "does not answer", true},
  };
  return faults;
}

}  // namespace palpate::testing
