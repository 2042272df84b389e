#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/recording/recording.h"

namespace palpate {

/// Consecutive ticks with the events up to them: an event precedes or accompanies the first tick that
/// acknowledges it. Either may be empty.
struct RecordingPart {
  std::span<const TickRecord> ticks;
  std::span<const RecordingEvent> events;
};

/// Recording that can be streamed from beginning to end any number of times, in memory independent of its
/// length.
class RecordingSource {
 public:
  /// Opens a file. An incomplete recording, or one still being written, is read up to its last complete
  /// flush. Damaged or foreign files and unsupported formats give an error, never a crash: HDF5 runs in a
  /// sandboxed copy of this process. Not to be used where a servo ticks; volume_io.h states the cost of the
  /// copy.
  static Result<RecordingSource> open(const std::filesystem::path& file, const Progress& progress = {});
  /// Source for a recording in memory, which outlives it.
  RecordingSource(const Recording& recording);  // NOLINT(google-explicit-constructor): it is one

  const RecordingHead& head() const { return head_; }
  /// Streams the whole recording in order, head().ticks ticks in total. `take` may stop by returning an
  /// error, which read() then returns. Errors: those of open(), kInterrupted, kBadInput if the file has been
  /// replaced since it was opened.
  Result<void> read(const std::function<Result<void>(const RecordingPart&)>& take,
                    const Progress& progress = {}) const;
  /// Consecutive ticks: up to `count` from row `first` on, counted from 0. Takes the same time at any row.
  /// Errors: those of read().
  Result<std::vector<TickRecord>> read_at(std::uint64_t first, std::uint64_t count,
                                          const Progress& progress = {}) const;

 private:
  RecordingSource(std::filesystem::path file, RecordingHead head)
      : file_(std::move(file)), head_(std::move(head)) {}

  std::filesystem::path file_;
  const Recording* memory_ = nullptr;
  RecordingHead head_;
};

/// Reads a whole recording into memory. Errors: those of RecordingSource.
Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress = {});

/// Names the first output of a device's tick that differs bitwise from the recorded one; empty if all are
/// equal. A recorded column that is 0 throughout may be missing in the file's format and is not compared.
std::string first_different_output(const DeviceTick& recorded, const DeviceTick& again);

}  // namespace palpate
