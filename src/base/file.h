#pragma once

#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>

#include "palpate/result.h"

namespace palpate {

/// The whole file. Errors: missing, a folder, unreadable, larger than `max_bytes`.
Result<std::string> read_file(const std::filesystem::path& file,
                              std::size_t max_bytes = std::size_t{1} << 30);

/// A file that appears whole under its name or not at all: write to path(), then commit(). Until then,
/// and after any failure, only a hidden temporary in the same folder exists, removed by the destructor.
class PendingFile {
 public:
  /// Checks that the target's folder exists and takes files, so that long work fails before it starts.
  /// The temporary keeps the target's ending (".nii.gz"), because writers choose the format by it. Where the
  /// target is a link, the file that it leads to is written.
  static Result<PendingFile> create(const std::filesystem::path& target);
  PendingFile(PendingFile&& other) noexcept;
  PendingFile& operator=(PendingFile&&) = delete;
  ~PendingFile();

  const std::filesystem::path& path() const { return temporary_; }
  /// Flushes to disk and renames over the target.
  Result<void> commit();

 private:
  PendingFile(std::filesystem::path target, std::filesystem::path temporary)
      : target_(std::move(target)), temporary_(std::move(temporary)) {}
  std::filesystem::path target_, temporary_;
};

/// Writes bytes whole or not at all.
Result<void> write_file(const std::filesystem::path& file, std::string_view bytes);

/// The error for an errno met while writing `file`, with what to do about it.
Error output_error(const std::filesystem::path& file, int error_number);

}  // namespace palpate
