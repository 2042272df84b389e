#include "openhaptics/openhaptics_failures.h"

namespace palpate::hd {
namespace {

struct Words {
  const char *what, *remedy;
};
Words words_for(Failure failure) {
  switch (failure) {
    case Failure::kLost:
      return {"the library has lost the device",
              "check its cable and power: it is restarted, and the session resumes when it is back"};
    case Failure::kStalled:
      return {"the scheduler of the library has stalled",
              "it is restarted. Is the machine overloaded? If this persists, restart the session"};
    case Failure::kOtherDevice:
      return {"a different device is connected", "connect the device with which the session started"};
    case Failure::kBroken:
      return {"the device reports an invalid position", "switch it off and on again"};
    case Failure::kReset:
      return {"the device is not calibrated",
              "hold the arm as its manual describes for a reset, and try again"};
    case Failure::kInkwell:
      return {"the device is not calibrated",
              "put the stylus into its inkwell for a moment, and take it out again"};
    case Failure::kWarm:
      return {"the motors are warm", "let them cool for some minutes, then press less hard"};
    case Failure::kForce:
      return {"the device reports that the force was too high", "release it for a second: the force returns"};
    case Failure::kVelocityTrip:
      return {"the device exceeded its speed limit", "hold it still for a second: the force returns"};
    case Failure::kNone:
      break;
  }
  return {"", ""};
}

}  // namespace

Error error_for(Failure failure, const std::string& where) {
  const Words words = words_for(failure);
  return {ErrorKind::kUnavailable, words.what, where, words.remedy};
}

}  // namespace palpate::hd
