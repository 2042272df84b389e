#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "palpate/base/output.h"

namespace palpate::internal {

/// Bytes on a disk. Every function answers 0 or an errno.
class ByteSink {
 public:
  virtual ~ByteSink() = default;
  virtual int write_at(std::uint64_t offset, std::span<const std::byte> bytes) = 0;
  /// Bytes beyond the end read as zero.
  virtual int read_at(std::uint64_t offset, std::span<std::byte> bytes) = 0;
  virtual int resize(std::uint64_t size) = 0;
  virtual int sync() = 0;
};

/// The descriptor, closed with the sink, and the file claimed as long.
std::unique_ptr<ByteSink> make_file_sink(int descriptor, OutputClaim claim);

/// An HDF5 file that a killed program or a full disk leaves readable. HDF5 writes in whatever order suits
/// its caches; here its writes are put into an order in which every prefix is a whole file:
///
///                                            committed end
///       0                                          |
///       [ superblock | objects, indices, rows ... ][ new rows, new blocks of the indices ...
///       \__ writes to here wait until commit() ___/ \__ written at once: nothing refers to them yet
///
/// commit() then writes, in this order,
///   1. the superblock, which now says that the file ends after the new bytes,
///   2. every other write that waits: blocks of the indices, which gain the places of rows beyond each
///      data set's extent,
///   3. the object headers ("OHDR"), whose extents make the new rows part of their data sets.
/// So each data set is as long as after the last commit or the one before, and what is inside an extent is
/// there. This rests on three properties of the files written here: freed space is never used again; an
/// index (HDF5's extensible array) never moves an entry; a chunk that was committed half full is replaced by
/// one that begins with the same rows.
///
/// When a write fails, error() says so, nothing more is written, and what was committed stays.
class CommitFile {
 public:
  explicit CommitFile(std::unique_ptr<ByteSink> sink) : sink_(std::move(sink)) {}

  void write(std::uint64_t offset, std::span<const std::byte> bytes);
  bool read(std::uint64_t offset, std::span<std::byte> bytes) const;
  /// The end of the space that HDF5 has allocated.
  void set_end(std::uint64_t end) { end_ = end; }
  std::uint64_t end() const { return end_; }
  /// Makes everything written so far part of the file, up to end(). False after any failure.
  bool commit();
  /// From here on writes are accepted and dropped: HDF5 insists on some when it closes.
  void seal() { sealed_ = true; }
  /// Gives back the space after the last commit and flushes to the disk.
  void trim_and_sync();

  /// The errno of the first failure, 0 when there was none.
  int error() const { return error_; }
  /// Nothing is written from here on.
  void fail(int error);

 private:
  struct Held {
    std::uint64_t offset;
    std::vector<std::byte> bytes;
  };
  void write_now(std::uint64_t offset, std::span<const std::byte> bytes);
  void hold(std::uint64_t offset, std::span<const std::byte> bytes);

  std::unique_ptr<ByteSink> sink_;
  std::vector<Held> held_;  ///< in the order of writing
  std::uint64_t end_ = 0, committed_end_ = 0, written_end_ = 0;
  bool sealed_ = false;
  int error_ = 0;
};

}  // namespace palpate::internal
