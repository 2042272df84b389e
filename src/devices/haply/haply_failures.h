#pragma once

#include <cstdint>
#include <string>

#include "haply/messages.h"
#include "palpate/base/result.h"

namespace palpate::haply {

/// Reasons for the absence of force, the most serious first.
enum class Failure : std::uint8_t {
  kNone,
  kLost,          ///< The connection was closed
  kNoService,     ///< The connection was closed, and no service answers
  kOtherVersion,  ///< The service that answers has an unsupported version
  kSilent,        ///< Requests are not answered
  kBroken,        ///< Replies are invalid
  kBehind,        ///< States may come from a queue (SenderPace), so that their age is unknown
  kBrake,         ///< A brake or a disconnection was reported recently
  kGone,          ///< A device is no longer in the service's list
  kNoPower,
  kNotCalibrated,
  kNotReady,
};

/// Failure reported by a device; anything that it does not report counts as fine.
Failure failure_of(const Status& status);

/// Description of a failure for the user, and its remedy; empty texts for kNone.
struct Words {
  const char *what, *remedy;
};
Words words_for(Failure failure);
/// Error with these words.
/// @param where  name of the device
Error error_for(Failure failure, const std::string& where);

/// Name for the user.
std::string name_of(const Inverse3& device);

}  // namespace palpate::haply
