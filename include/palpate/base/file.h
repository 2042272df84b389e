#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <utility>

#include "palpate/base/output.h"
#include "palpate/base/result.h"

namespace palpate {

/// Regular file opened for reading; all of palpate opens its input files through this class. A pipe, device,
/// socket or folder is reported as an error at once instead of blocking in open or read.
class InputFile {
 public:
  /// Opens a regular file. Errors: kBadInput if it is missing, unreadable, a folder, a pipe, a device or a
  /// socket.
  static Result<InputFile> open(const std::filesystem::path& file);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile();

  /// File descriptor, owned by this object; its offset is at the start of the file until something reads.
  int descriptor() const { return descriptor_; }
  /// File size when it was opened; bytes.
  std::uint64_t size() const { return size_; }
  /// Path under which a library that expects a file name opens this very file, even if it has been renamed or
  /// replaced since; valid in this process while this object lives.
  std::filesystem::path name_for_libraries() const;
  /// Reads the next bytes.
  /// @param bytes  buffer to fill
  /// Returns the number of bytes read, fewer than `bytes.size()` only at the end of the file. Errors:
  /// kBadInput if the read fails.
  Result<std::size_t> read(std::span<std::byte> bytes);
  /// Reads from `offset` (bytes) on, without moving the file offset; otherwise as read().
  Result<std::size_t> read_at(std::uint64_t offset, std::span<std::byte> bytes) const;

 private:
  InputFile(int descriptor, std::uint64_t size, std::filesystem::path file)
      : descriptor_(descriptor), size_(size), file_(std::move(file)) {}
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  std::filesystem::path file_;
};

/// Contents of a file. Errors: those of InputFile::open; kBadInput if it is larger than `max_bytes`.
Result<std::string> read_file(const std::filesystem::path& file,
                              std::size_t max_bytes = std::size_t{1} << 30);

/// Durability of a committed file. kToDisk: complete even after a power cut. kNone: a power cut may leave it
/// incomplete; the death of the process never does.
enum class Flush { kToDisk, kNone };

/// Output file that appears complete under its name or not at all: write to path(), then commit(). Until
/// then, and after any failure, only a hidden temporary file in the same folder exists, which the destructor
/// removes. Claims the target (palpate/base/output.h) while it lives.
class PendingFile {
 public:
  /// Creates the temporary file, so that a missing or read-only folder is reported before long work starts.
  /// The temporary has the target's extension (".nii.gz"), because writers choose the format by it. If the
  /// target is a symbolic link, the file that it refers to is written.
  static Result<PendingFile> create(const std::filesystem::path& target);
  PendingFile(PendingFile&& other) noexcept;
  PendingFile& operator=(PendingFile&&) = delete;
  ~PendingFile();

  const std::filesystem::path& path() const { return temporary_; }
  /// Renames the temporary over the target, after flushing it to disk if requested.
  Result<void> commit(Flush flush = Flush::kToDisk);

 private:
  PendingFile(OutputClaim claim, std::filesystem::path target, std::filesystem::path temporary)
      : claim_(std::move(claim)), target_(std::move(target)), temporary_(std::move(temporary)) {}
  OutputClaim claim_;
  std::filesystem::path target_, temporary_;
};

/// Writes a file through a PendingFile: complete or not at all.
Result<void> write_file(const std::filesystem::path& file, std::string_view bytes);

/// Error (kOutput) for an errno that occurred while writing `file`, with a remedy.
Error output_error(const std::filesystem::path& file, int error_number);

}  // namespace palpate
