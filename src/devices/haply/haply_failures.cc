#include "haply/haply_failures.h"

namespace palpate::haply {

Failure failure_of(const Status& status) {
  if (!status.power_supply.value_or(true)) return Failure::kNoPower;
  if (!status.calibrated.value_or(true)) return Failure::kNotCalibrated;
  if (!status.ready.value_or(true) || !status.started.value_or(true)) return Failure::kNotReady;
  return Failure::kNone;
}

Words words_for(Failure failure) {
  switch (failure) {
    case Failure::kLost:
      return {"the Inverse Service has closed the connection",
              "no action is needed: the session resumes when it is connected again"};
    case Failure::kNoService:
      return {"the Inverse Service does not answer", "restart it: the session then resumes by itself"};
    case Failure::kOtherVersion:
      return {"the version of the Inverse Service is not supported",
              "start version 3.0, 3.1, or 3.5 or later: the session then resumes by itself"};
    case Failure::kSilent:
      return {"the Inverse Service sends no states",
              "is the machine overloaded? If this persists, restart the service"};
    case Failure::kBroken:
      return {"the Inverse Service sends messages that are not device states",
              "does another program listen on its port? Restart the service"};
    case Failure::kBehind:
      return {"the Inverse Service sends more states than usual, or stalled: states may be outdated",
              "wait a moment; if this persists, close other programs that request states, or restart it"};
    case Failure::kBrake:
      return {"the device's brake is on, or it was unplugged",
              "release the brake and check the USB cable: the session resumes a second later"};
    case Failure::kGone:
      return {"the service has lost the device", "check its USB cable, and reconnect it"};
    case Failure::kNoPower:
      return {"the device has no power", "connect its power supply"};
    case Failure::kNotCalibrated:
      return {"the device is not calibrated",
              "move its arm as described in Haply's manual until it is calibrated"};
    case Failure::kNotReady:
      return {"the device is not ready", "wait until its light shows that it is ready, or reconnect it"};
    case Failure::kNone:
      break;
  }
  return {"", ""};
}

Error error_for(Failure failure, const std::string& where) {
  const Words words = words_for(failure);
  return {ErrorKind::kUnavailable, words.what, where, words.remedy};
}

std::string name_of(const Inverse3& device) {
  return "Inverse3 " + device.id;
}

}  // namespace palpate::haply
