#include "force_dimension/models.h"

#include "force_dimension/dhd.h"

namespace palpate::dhd {

DeviceModel model_of(int type) {
  DeviceModel model{"Force Dimension device", {}, {}, {}, {}, {}};
  const auto omega = [&](const char* name) {
    model.name = name;
    model.peak_force_N = 12;
    model.position_step_mm = 0.01;
    model.reach_mm = 75;
  };
  switch (type) {
    case kOmega3:
      omega("omega.3");
      break;
    case kOmega6:
    case kOmega6Left:
      omega("omega.6");
      model.turns = true;
      break;
    case kOmega7:
    case kOmega7Left:
      omega("omega.7");
      model.turns = model.gripper = true;
      model.peak_gripper_N = 8;
      break;
    case kSigma7:
    case kSigma7Left:
      model = {"sigma.7", 20, {}, 400, 0.0015, 75, true, true};
      break;
    case kDelta3:
      model.name = "delta.3";
      break;
    case kDelta6:
      model.name = "delta.6";
      model.turns = true;
      break;
    case kFalcon:
      model = {"Falcon", 8, {}, {}, 0.063, 40, false, false, 4, true};
      break;
    default:
      break;
  }
  return model;
}

}  // namespace palpate::dhd
