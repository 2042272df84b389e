#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"

namespace palpate {

/// File to download, and how to verify it.
struct Download {
  std::string url;
  std::filesystem::path target;                      ///< Its folder must exist.
  std::optional<std::uint64_t> bytes;                ///< Exact size if it is known.
  std::string sha256, git_blob;                      ///< At least one of the two; lower-case hexadecimal.
  std::uint64_t max_bytes = std::uint64_t{1} << 30;  ///< Maximum size; a larger file is rejected.
  bool allow_http = false;
  double stall_timeout_s = 20;
  double first_pause_s = 1;  ///< Pause before the second attempt; doubles after each attempt.
  int attempts = 4;
};

/// Verifies a file. Errors: kBadInput with the expected and the actual value if size or hash differ.
Result<void> check_content(const std::filesystem::path& file, const std::optional<std::uint64_t>& bytes,
                           const std::string& sha256, const std::string& git_blob);

/// Downloads to target.part, resuming a partial file of an earlier call, verifies the content and renames.
/// Only the hash reveals whether the parts of a resumed file belong together: if it is wrong, the file is
/// downloaded once more from the beginning; a file that is wrong although it was downloaded in one piece is
/// deleted, with an error. A second process that downloads the same file is rejected. Errors: kUnavailable,
/// kOutput, kInterrupted.
Result<void> download(const Download& download, const Progress& progress);

}  // namespace palpate
