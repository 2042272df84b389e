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

/// The ticks of a recording around the place at which it is played, read by a thread of its own in blocks.
/// Any thread.
class TickBlocks {
 public:
  using Block = std::vector<TickRecord>;
  /// Reads one block, by its number; on the thread of the reader.
  using Read = std::function<Result<Block>(std::size_t block, const Progress& progress)>;

  /// Ticks of a block, and how many blocks are kept: some 40 MB.
  static constexpr std::uint64_t kTicks = 4096;
  static constexpr std::size_t kMostKept = 4;

  /// @param begins_s  time of each block's first tick, rising; not empty
  /// @throws std::system_error  there is no thread to be had
  TickBlocks(Read read, std::vector<double> begins_s);
  ~TickBlocks();
  TickBlocks(const TickBlocks&) = delete;
  TickBlocks& operator=(const TickBlocks&) = delete;

  /// The last tick that is not after `at_s`, where its block has been read; from now on that is read first.
  /// Until then, where it plays, a tick of the nearest block that has been read of those that it has come
  /// through: a reader that is slower than what is played still shows how far it is.
  /// @param way     1: it plays, -1: backwards, 0: it rests
  /// @param from_s  where it began to play
  std::optional<TickRecord> tick_at(double at_s, int way, double from_s);
  /// The tick in a row, where its block is kept.
  std::optional<TickRecord> kept_at(std::uint64_t row) const;
  /// Why nothing more is read.
  std::optional<Error> failure() const;
  /// What could not be read is read anew: a busy machine has no process for a reader now and then.
  void try_again();

 private:
  struct Kept {
    std::size_t number;
    Block ticks;
  };

  std::size_t block_at(double at_s) const;
  const Block* find(std::size_t block);
  bool is_kept(std::size_t block) const;
  std::optional<TickRecord> nearest_played(std::size_t block, int way, std::size_t from) const;
  std::optional<std::size_t> missing() const;
  void read();

  const Read read_block_;
  const std::vector<double> begins_s_;

  mutable std::mutex mutex_;  // of what follows
  std::condition_variable wanted_changed_;
  std::list<Kept> kept_;  // what was wanted last stands first
  std::size_t wanted_ = 0;
  int way_ = 0;
  std::optional<Error> failure_;

  std::atomic<bool> ending_{false};
  std::thread reader_;
};

}  // namespace palpate
