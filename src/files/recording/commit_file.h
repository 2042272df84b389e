#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/base/output.h"

namespace palpate::internal {

/// Random-access byte storage. Every function returns 0 or an errno value.
class ByteSink {
 public:
  virtual ~ByteSink() = default;
  virtual int write_at(std::uint64_t offset, std::span<const std::byte> bytes) = 0;
  /// Bytes beyond the end read as zero.
  virtual int read_at(std::uint64_t offset, std::span<std::byte> bytes) = 0;
  virtual int resize(std::uint64_t size) = 0;
  virtual int sync() = 0;
};

/// Sink for a descriptor, which it closes; it holds the file's claim for its lifetime.
std::unique_ptr<ByteSink> make_file_sink(int descriptor, OutputClaim claim);

/// HDF5 file that stays readable if the process is killed or the disk is full. HDF5 writes in the order of
/// its caches; this class reorders the writes so that every prefix of them is a valid file:
///
///                                           committed end
///      0                                          |
///      [ superblock | objects, indices, rows ... ][ new rows, new blocks of the indices ...
///      \__ writes deferred until commit() _______/ \__ written at once: nothing refers to them yet
///
/// commit() then writes, in this order,
///  1. the superblock, which now says that the file ends after the new bytes,
///  2. all other deferred writes: blocks of the indices, which gain the addresses of rows beyond each
///     data set's extent,
///  3. the object headers ("OHDR"), whose extents make the new rows part of their data sets.
/// Each data set therefore has its extent of the last commit or the one before, and everything inside an
/// extent is present. This relies on three properties of the files written here: freed space is never reused;
/// an index (HDF5's extensible array) never moves an entry; a chunk that was committed half full is replaced
/// by one that begins with the same rows.
///
/// After a failed write error() returns its errno, nothing more is written, and the last commit stays intact.
class CommitFile {
 public:
  explicit CommitFile(std::unique_ptr<ByteSink> sink) : sink_(std::move(sink)) {}

  void write(std::uint64_t offset, std::span<const std::byte> bytes);
  bool read(std::uint64_t offset, std::span<std::byte> bytes) const;
  /// End of the space that HDF5 has allocated.
  void set_end(std::uint64_t end) { end_ = end; }
  std::uint64_t end() const { return end_; }
  /// Makes everything written so far part of the file, up to end(). False after any failure.
  bool commit();
  /// Ignores all further writes: HDF5 performs some when it closes.
  void seal() { sealed_ = true; }
  /// Truncates the file to the last commit and syncs it to disk.
  void trim_and_sync();

  /// errno of the first failure; 0: none.
  int error() const { return error_; }
  /// Records a failure; nothing is written from here on.
  void fail(int error);

 private:
  struct PendingWrite {
    std::uint64_t offset;
    std::vector<std::byte> bytes;
  };
  void write_now(std::uint64_t offset, std::span<const std::byte> bytes);
  void defer(std::uint64_t offset, std::span<const std::byte> bytes);

  std::unique_ptr<ByteSink> sink_;
  std::vector<PendingWrite> pending_;  ///< deferred writes, chronological
  std::uint64_t end_ = 0, committed_end_ = 0, written_end_ = 0;
  bool sealed_ = false;
  int error_ = 0;
};

}  // namespace palpate::internal
