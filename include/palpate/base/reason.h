#pragma once

#include <exception>
#include <filesystem>
#include <string>

namespace palpate {

/// What an exception says, without the names of files that one of the filesystem's carries: an Error's `what`
/// may be told to viewers, who are told the name of no file.
inline std::string reason_of(const std::exception& why) {
  const auto* failed = dynamic_cast<const std::filesystem::filesystem_error*>(&why);
  return failed != nullptr ? failed->code().message() : why.what();
}

}  // namespace palpate
