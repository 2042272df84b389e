#pragma once

#include <cstdint>
#include <string>

#include "palpate/base/result.h"

namespace palpate::dhd {

/// Reasons for the absence of force, the most serious first.
enum class Failure : std::uint8_t {
  kNone,
  kLost,         ///< Calls fail, and the device is searched for
  kInUse,        ///< It is connected, but cannot be opened
  kOtherDevice,  ///< Another device is in its place
  kNoPower,
  kNotInitialised,             ///< Its arm's position is unknown
  kNeedsManualInitialisation,  ///< It has to be moved through its workspace manually
  kError,                      ///< It reports an error
  kBroken,                     ///< Its pose is not finite
  kButton,                     ///< Forces were disabled at the device
  kVelocity,                   ///< It exceeded its speed limit
  kWatchdog,                   ///< Its watchdog expired
  kUsb,
  kDeadman,     ///< Its dead man's switch is released
  kForceOff,    ///< Forces are disabled for an unknown reason
  kCallFailed,  ///< A call failed
};

/// Description of a failure for the user, and its remedy; empty texts for kNone.
struct Words {
  const char *what, *remedy;
};
Words words_for(Failure failure);
/// Error with these words.
/// @param where  name of the device
Error error_for(Failure failure, const std::string& where);

}  // namespace palpate::dhd
