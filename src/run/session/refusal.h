#pragma once

#include <string>
#include <utility>

#include "palpate/base/result.h"

/// Errors with which a session answers requests that it does not carry out.
namespace palpate {

/// @param where   name of the offending value; empty: none
/// @param remedy  what the requester can do instead; empty: nothing
inline Error invalid_value(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kBadInput, std::move(what), std::move(where), std::move(remedy)};
}
inline Error refusal(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}
inline Error not_running() {
  return {ErrorKind::kUnavailable, "the session is not running yet", "", "try again in a moment"};
}

}  // namespace palpate
