#pragma once

#include <atomic>
#include <condition_variable>
#include <cstdint>
#include <functional>
#include <list>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"

namespace palpate {

/// Cache of a recording's ticks around the playback position, read in blocks by a thread of its own.
/// Thread-safe.
class TickBlocks {
 public:
  using Block = std::vector<TickRecord>;
  /// Reads one block by its number; called on the reader's thread.
  using Read = std::function<Result<Block>(std::size_t block, const Progress& progress)>;

  /// Ticks per block and number of cached blocks: about 40 MB.
  static constexpr std::uint64_t kTicks = 4096;
  static constexpr std::size_t kMaxStored = 4;

  /// @param begins_s  time of each block's first tick, ascending; not empty
  /// @throws std::system_error  if no thread can be created
  TickBlocks(Read read, std::vector<double> begins_s);
  ~TickBlocks();
  TickBlocks(const TickBlocks&) = delete;
  TickBlocks& operator=(const TickBlocks&) = delete;

  /// Last tick not after `at_s`, if its block has been read; the block is read with priority from now on.
  /// Until then, during playback, a tick of the nearest cached block between `from_s` and `at_s`: if reading
  /// is slower than playback the picture still advances.
  /// @param direction  1: forwards, -1: backwards, 0: paused
  /// @param from_s     position at which playback began
  std::optional<TickRecord> tick_at(double at_s, int direction, double from_s);
  /// Tick in a row, if its block is cached.
  std::optional<TickRecord> stored_at(std::uint64_t row) const;
  /// Reason why reading has stopped.
  std::optional<Error> failure() const;
  /// Retries after a failure: a busy machine may temporarily be unable to start a reader process.
  void try_again();

 private:
  struct CachedBlock {
    std::size_t number;
    Block ticks;
  };

  std::size_t block_at(double at_s) const;
  const Block* find(std::size_t block);
  bool is_stored(std::size_t block) const;
  std::optional<TickRecord> nearest_played(std::size_t block, int direction, std::size_t from) const;
  std::optional<std::size_t> missing() const;
  void read();

  const Read read_block_;
  const std::vector<double> begins_s_;

  mutable std::mutex mutex_;  // guards the members below
  std::condition_variable requested_changed_;
  std::list<CachedBlock> stored_;  // most recently wanted first
  std::size_t wanted_ = 0;
  int direction_ = 0;
  std::optional<Error> failure_;

  std::atomic<bool> ending_{false};
  std::thread reader_;
};

}  // namespace palpate
