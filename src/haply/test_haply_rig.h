#pragma once

#include <memory>
#include <string>

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

/// A driver that runs against a service.
class HaplyRig : public HaplySide, public DriverRig<HaplyDriver> {
 public:
  explicit HaplyRig(const std::string& version = "3.1.1", bool begins = true)
      : HaplySide(version),
        DriverRig(std::make_unique<HaplyDriver>(service.settings()), [this] { return service.force_N(); }) {
    if (begins) open_and_begin();
  }
};

}  // namespace palpate::testing
