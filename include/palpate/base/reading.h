#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

#include "palpate/base/result.h"

/// Limits on what input files of unknown origin may do: how much memory they may take, and where file names
/// in them may lead. Process-wide, set before anything is read.
namespace palpate {

struct ReadingLimits {
  /// Maximum memory of the process; bytes. 0: resident memory at the first request plus half of the memory
  /// then available to the machine and to its control group.
  std::uint64_t max_memory_bytes = 0;
  /// Accept data files named by a header or a scene that lie outside its folder, through links or `..`.
  bool follow_links = false;
};
void set_reading_limits(const ReadingLimits& limits);
const ReadingLimits& reading_limits();

/// Checks that the process may take more memory. Call it before the allocation; memory already resident
/// counts.
/// @param more_bytes  memory to be allocated in addition
/// @param what        subject of the error: what is to be read or prepared
/// Errors: kBadInput with the memory needed, the memory allowed and how to allow more.
Result<void> check_memory(std::uint64_t more_bytes, const std::string& what);

/// Checks that a file named by something in `folder` lies in that folder or below it after links are
/// resolved. Errors: kBadInput if it does not, unless follow_links is set. A missing file passes: the reader
/// reports it.
Result<void> check_stays_in(const std::filesystem::path& folder, const std::filesystem::path& file);

/// Human-readable size: "5.1 GiB", "1.3 MiB".
std::string memory_size_text(std::uint64_t bytes);
/// Bytes from "800M", "1.5GiB" or "4G" (binary units KiB, MiB, GiB, TiB); 0 for anything else.
std::uint64_t parse_memory_size(const std::string& text);

}  // namespace palpate
