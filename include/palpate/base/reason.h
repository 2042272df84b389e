#pragma once

#include <exception>
#include <filesystem>
#include <string>

namespace palpate {

/// Message of an exception, without the file names that a filesystem_error contains: an Error's `what` may be
/// sent to viewers, which must not learn file names.
inline std::string reason_of(const std::exception& why) {
  const auto* failed = dynamic_cast<const std::filesystem::filesystem_error*>(&why);
  return failed != nullptr ? failed->code().message() : why.what();
}

}  // namespace palpate
