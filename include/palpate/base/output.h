#pragma once

#include <filesystem>
#include <span>
#include <string>
#include <utility>

#include "palpate/base/result.h"

namespace palpate {

/// Whether two names mean one file: spelled differently, through links, and also where no file is yet.
bool same_file(const std::filesystem::path& a, const std::filesystem::path& b);

/// That this process, and no other, writes a file now; until the object is gone. Within the process claims of
/// one file do not exclude each other. Others see it by a hidden file beside the target, locked as long as
/// the process lives, so that what a killed one left behind claims nothing. On a disk that knows no locks
/// nothing is excluded.
class OutputClaim {
 public:
  /// Removes the temporaries of this account's killed processes that wrote this file or another one of its
  /// folder; those of a process that lives stay. On a disk that knows no locks, those of this file alone.
  /// Errors: kOutput where the folder is missing or takes no files, and where another process has a claim.
  static Result<OutputClaim> take(const std::filesystem::path& file);
  OutputClaim(OutputClaim&& other) noexcept : lock_(std::exchange(other.lock_, {})) {}
  OutputClaim& operator=(OutputClaim&& other) noexcept {
    std::swap(lock_, other.lock_);
    return *this;
  }
  ~OutputClaim();

 private:
  explicit OutputClaim(std::string lock) : lock_(std::move(lock)) {}
  std::string lock_;
};

/// Removes what this process has begun to write and not finished: temporaries, locks, folders of work. For a
/// program that ends at once, whatever its other threads are doing; what one of them holds just then stays,
/// and the next run on that output sweeps it.
void abandon_outputs() noexcept;

/// Claims a file for a run that will write it: it could be written now, its folder exists and takes files, it
/// is not a folder or a device itself, and no other process is writing it. Asked before long work, so that a
/// wrong name costs nothing, and kept until the file is written.
/// @param never  files that are read for it and that it must not replace
/// Errors: kUsage when it is one of `never`, kOutput otherwise.
Result<OutputClaim> claim_output(const std::filesystem::path& file,
                                 std::span<const std::filesystem::path> never = {});

}  // namespace palpate
