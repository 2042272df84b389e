#pragma once

#include <cstdint>
#include <string>

#include "palpate/base/result.h"

namespace palpate::hd {

/// Reasons for the absence of force, the most serious first.
enum class Failure : std::uint8_t {
  kNone,
  kLost,         ///< The library cannot reach the device
  kStalled,      ///< The scheduler makes no calls
  kOtherDevice,  ///< Another device has that name
  kBroken,       ///< Its pose is invalid
  kReset,        ///< The arm has to be placed in the position where its encoders are reset
  kInkwell,      ///< The stylus has to be placed in its inkwell
  kWarm,
  kForce,
  kVelocityTrip,
};

/// Error with the description of the failure for the user, and the remedy.
/// @param where  name of the device
Error error_for(Failure failure, const std::string& where);

}  // namespace palpate::hd
