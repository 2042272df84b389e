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

/// An ordinary file that is open for reading: the one way in which this program opens one. What only looks
/// like a file is an error at once, where reading it, or opening it already, would wait for somebody else.
class InputFile {
 public:
  /// Errors: missing, a folder, a pipe, a device, a socket, unreadable.
  static Result<InputFile> open(const std::filesystem::path& file);
  InputFile(InputFile&& other) noexcept;
  InputFile& operator=(InputFile&& other) noexcept;
  ~InputFile();

  /// Stays this object's own, at the front of the file until something reads.
  int descriptor() const { return descriptor_; }
  /// Bytes, when it was opened.
  std::uint64_t size() const { return size_; }
  /// A name by which a library that takes names opens this very file, whatever has become of its own; as long
  /// as this object and its process live.
  std::filesystem::path name_for_libraries() const;
  /// The next bytes; fewer than asked for only at the end. Errors: of the disk.
  Result<std::size_t> read(std::span<std::byte> bytes);
  /// The bytes from an offset on; otherwise as read().
  Result<std::size_t> read_at(std::uint64_t offset, std::span<std::byte> bytes) const;

 private:
  InputFile(int descriptor, std::uint64_t size, std::filesystem::path file)
      : descriptor_(descriptor), size_(size), file_(std::move(file)) {}
  int descriptor_ = -1;
  std::uint64_t size_ = 0;
  std::filesystem::path file_;
};

/// The whole file. Errors: those of InputFile::open, larger than `max_bytes`.
Result<std::string> read_file(const std::filesystem::path& file,
                              std::size_t max_bytes = std::size_t{1} << 30);

/// Whether a power cut may leave a file that is not whole; a process that dies never does.
enum class Flush { kToDisk, kNot };

/// A file that appears whole under its name or not at all: write to path(), then commit(). Until then,
/// and after any failure, only a hidden temporary in the same folder exists, removed by the destructor. It
/// claims the target (palpate/base/output.h) while it lives.
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
  /// Flushes to disk, unless that is not asked for, and renames over the target.
  Result<void> commit(Flush flush = Flush::kToDisk);

 private:
  PendingFile(OutputClaim claim, std::filesystem::path target, std::filesystem::path temporary)
      : claim_(std::move(claim)), target_(std::move(target)), temporary_(std::move(temporary)) {}
  OutputClaim claim_;
  std::filesystem::path target_, temporary_;
};

/// Writes bytes whole or not at all.
Result<void> write_file(const std::filesystem::path& file, std::string_view bytes);

/// The error for an errno met while writing `file`, with what to do about it.
Error output_error(const std::filesystem::path& file, int error_number);

/// A folder that abandon_outputs() removes with everything in it, as long as this lives.
class UnfinishedFolder {
 public:
  explicit UnfinishedFolder(std::filesystem::path folder);
  UnfinishedFolder(UnfinishedFolder&& other) noexcept : folder_(std::exchange(other.folder_, {})) {}
  UnfinishedFolder& operator=(UnfinishedFolder&&) = delete;
  ~UnfinishedFolder();

 private:
  std::filesystem::path folder_;
};

}  // namespace palpate
