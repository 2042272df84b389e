#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/result.h"
#include "palpate/recording/event_log.h"
#include "palpate/recording/recording.h"

namespace palpate {

template <class T>
class SpscRing;

/// Appends ticks to a file and flushes at least once per second of recorded time, so that a killed process or
/// a full disk loses at most the last second. Not for the servo thread.
class RecordingWriter {
 public:
  /// Replaces `file` by a recording without ticks, or leaves it unchanged on failure. Errors: kBadInput for
  /// an invalid header (devices, rate, texts above 4096 bytes, scripts above 16 MiB), kOutput.
  static Result<std::unique_ptr<RecordingWriter>> create(const std::filesystem::path& file,
                                                         const RecordingHeader& header);
  virtual ~RecordingWriter() = default;
  /// Appends ticks, each with the header's number of devices. Error kOutput if writing fails (disk full or
  /// gone), then also on every later call; what was flushed before stays readable.
  /// @param events  events of these ticks, ascending; written before the first tick that acknowledges them
  virtual Result<void> append(std::span<const TickRecord> ticks,
                              std::span<const RecordingEvent> events = {}) = 0;
  /// Flushes, writes the summary and closes the file; no further call is permitted. Without finish() the
  /// destructor flushes all ticks, and the recording counts as incomplete.
  virtual Result<void> finish(const RecordingSummary& summary) = 0;
};

/// Writes the ticks of a run from a ring to disk, on a thread of its own. Decouples the servo, which must not
/// block, from the disk, which may. The ring is emptied every few milliseconds and must hold the ticks that
/// arrive during the longest write.
class Recorder {
 public:
  using OnTick = std::function<void(const TickRecord&, std::span<const RecordingEvent>)>;
  /// @param ring     outlives the recorder, which is its only consumer
  /// @param file     as for RecordingWriter::create; empty: ticks are counted and passed to `on_tick`, but
  ///                 not stored
  /// @param on_tick  called on the recorder's thread with every tick in order, and with the events that this
  ///                 tick is the first to acknowledge, as they are written; may be empty; must not throw. Its
  ///                 time adds to that of a write.
  /// @param log      log of external commands; outlives the recorder, its only consumer; may be null
  /// Errors: those of RecordingWriter::create, kUnavailable if no thread can be created.
  static Result<std::unique_ptr<Recorder>> start(SpscRing<TickRecord>& ring,
                                                 const std::filesystem::path& file,
                                                 const RecordingHeader& header, OnTick on_tick = {},
                                                 EventLog* log = nullptr);
  /// Drains the ring and stops. A recording without finish() counts as incomplete.
  virtual ~Recorder() = default;
  /// Totals so far; `dropped`, `skipped` and `problems` are set by finish(). Thread-safe.
  virtual RecordingSummary so_far() const = 0;
  /// Reason why writing has ended: the disk is full or gone. Ticks are still counted and passed to `on_tick`.
  /// Thread-safe.
  virtual std::optional<Error> failure() const = 0;
  /// Drains the ring, writes the summary and closes the file; call it after the last push, and no other
  /// function afterwards. Returns failure() if any write failed, the last one included.
  /// @param dropped, skipped  totals of the run, for the summary
  virtual Result<RecordingSummary> finish(std::uint64_t dropped, std::uint64_t skipped,
                                          const std::vector<std::string>& problems) = 0;
};

}  // namespace palpate
