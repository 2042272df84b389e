#include "force_dimension/force_dimension_failures.h"

namespace palpate::dhd {

Words words_for(Failure failure) {
  switch (failure) {
    case Failure::kLost:
      return {"the device was disconnected",
              "check its USB cable and power: the session resumes when it is reconnected"};
    case Failure::kInUse:
      return {"the device is connected but cannot be opened",
              "close the program that uses it; palpate doctor checks the permissions of this account"};
    case Failure::kOtherDevice:
      return {"a different device is connected", "connect the device with which the session started"};
    case Failure::kNoPower:
      return {"the device has no power", "switch on its power supply"};
    case Failure::kNotInitialised:
      return {"the arm is not initialised, so its position is unknown",
              "keep clear of it and initialise it with the vendor's program (HapticInit): the session then "
              "resumes by itself. Or end the session and restart it with --may-move"};
    case Failure::kNeedsManualInitialisation:
      return {"the position of the grip is not calibrated yet",
              "pull the grip all the way out and push it all the way in, until the lights turn"};
    case Failure::kError:
      return {"the device reports an error", "switch it off and on again"};
    case Failure::kBroken:
      return {"the device reports an invalid position", "switch it off and on again"};
    case Failure::kButton:
      return {"forces are disabled at the device", "press its force button"};
    case Failure::kVelocity:
      return {"the device exceeded its speed limit and has disabled its forces",
              "hold it still: they return after a second"};
    case Failure::kWatchdog:
      return {"the device has disabled its forces because it received no commands",
              "hold it still: they return after a second. Is the machine overloaded?"};
    case Failure::kUsb:
      return {"the device has disabled its forces because of a USB error", "check its USB cable"};
    case Failure::kDeadman:
      return {"the grip of the device is not held", "hold its grip"};
    case Failure::kForceOff:
      return {"the device has disabled its forces without giving a reason",
              "press its force button, or restart the session"};
    case Failure::kCallFailed:
      return {"the device does not answer", "check its USB cable"};
    case Failure::kNone:
      break;
  }
  return {"", ""};
}

Error error_for(Failure failure, const std::string& where) {
  const Words words = words_for(failure);
  return {ErrorKind::kUnavailable, words.what, where, words.remedy};
}

}  // namespace palpate::dhd
