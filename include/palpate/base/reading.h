#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "palpate/base/result.h"

/// What files of unknown origin may take of this machine, and where they may lead. One answer for the whole
/// process, given before anything is read: memory belongs to the process, and so does trust.
namespace palpate {

struct ReadingLimits {
  /// The most memory that the process may have, bytes; 0: what it has when it first asks and half of what is
  /// then available, to the machine and to its control group.
  std::uint64_t most_memory_bytes = 0;
  /// Data files that a header or a scene names may stand outside its folder, through links or `..`.
  bool follow_links = false;
};
void set_reading_limits(const ReadingLimits& limits);
const ReadingLimits& reading_limits();

/// Asked before memory is taken. Counts what the process has already.
/// @param what  is to be read or prepared; names the error
/// Errors: kBadInput with what is needed, what is allowed and how to allow more.
Result<void> allow_memory(std::uint64_t more_bytes, const std::string& what);

/// Errors: kBadInput where a file that something in `folder` names does not stand in that folder or below it,
/// once links are followed, and this is not allowed. A file that is missing is for those to find who read it.
Result<void> check_stays_in(const std::filesystem::path& folder, const std::filesystem::path& file);

/// "5.1 GiB", "1.3 MiB"
std::string memory_text(std::uint64_t bytes);
/// Bytes from "800M", "1.5GiB", "4G" (KiB, MiB, GiB and TiB are meant); 0 for anything else.
std::uint64_t memory_bytes(const std::string& text);

}  // namespace palpate
