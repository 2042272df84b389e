#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <utility>

#include "palpate/base/result.h"

namespace palpate {

/// True if two paths refer to the same file: under different spellings, through links, and also if the file
/// does not exist yet.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

/// Exclusive claim of this process on an output file, released by the destructor. Claims of one file within
/// the process do not exclude each other. Other processes recognise the claim by a hidden file in the same
/// folder that is locked while the process lives, so a lock file left by a killed process claims nothing. A
/// file system without locks excludes nothing.
class OutputClaim {
 public:
  /// Claims `file`. Removes temporaries that killed processes of this account left for this file and for
  /// other files of its folder; those of running processes stay. On a file system without locks, only those
  /// of this file are removed. Errors: kOutput if the folder is missing or not writable, or if another
  /// process has claimed the file.
  static Result<OutputClaim> take(const std::filesystem::path& file);
  OutputClaim(OutputClaim&& other) noexcept : lock_path_(std::exchange(other.lock_path_, {})) {}
  OutputClaim& operator=(OutputClaim&& other) noexcept {
    std::swap(lock_path_, other.lock_path_);
    return *this;
  }
  ~OutputClaim();

 private:
  explicit OutputClaim(std::string lock) : lock_path_(std::move(lock)) {}
  std::string lock_path_;
};

/// Removes everything that this process has begun to write and not finished: temporaries, lock files,
/// UnfinishedFolders. For a program that exits immediately, whatever its other threads are doing. If another
/// thread holds the registry at that moment nothing is removed, and the next run on that output does it.
void abandon_outputs() noexcept;

/// Folder that abandon_outputs() removes with its contents while this object lives.
class UnfinishedFolder {
 public:
  explicit UnfinishedFolder(std::filesystem::path folder);
  UnfinishedFolder(UnfinishedFolder&& other) noexcept : folder_(std::exchange(other.folder_, {})) {}
  UnfinishedFolder& operator=(UnfinishedFolder&&) = delete;
  ~UnfinishedFolder();

 private:
  std::filesystem::path folder_;
};

/// Claims a file that a run will write, until the claim is destroyed. Checks that its folder exists and is
/// writable, that the file is no folder or device, and that no other process is writing it. Call it before
/// long work, so that a wrong name is reported at once.
/// @param inputs  files that the output must not replace
/// Errors: kUsage if `file` is one of `inputs`, kOutput otherwise.
Result<OutputClaim> claim_output(const std::filesystem::path& file,
                                 std::span<const std::filesystem::path> inputs = {});

}  // namespace palpate
