#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

namespace palpate {

/// One file to fetch, and how to know that it is the right one.
struct Download {
  std::string url;
  std::filesystem::path target;                      ///< its folder exists
  std::optional<std::uint64_t> bytes;                ///< exact size, where known
  std::string sha256, git_blob;                      ///< at least one of the two, lower-case hex
  std::uint64_t max_bytes = std::uint64_t{1} << 30;  ///< more than this is refused
  bool allow_http = false;
  double stall_timeout_s = 20;
  double first_pause_s = 1;  ///< before the second attempt; doubles after each
  int attempts = 4;
};

/// Error kBadInput naming both when the file's size or hash is not what is expected.
Result<void> check_content(const std::filesystem::path& file, const std::optional<std::uint64_t>& bytes,
                           const std::string& sha256, const std::string& git_blob);

/// Downloads to target.part, resuming what an earlier call left there, checks the content and renames.
/// The hash alone says whether two halves belong together: a resumed file that is wrong is fetched once
/// more from its beginning, a file that is wrong although it came in one piece is deleted and an error.
/// A second process that fetches the same file is refused.
/// Errors: kUnavailable, kOutput, kInterrupted.
Result<void> download(const Download& download, const Progress& progress);

}  // namespace palpate
