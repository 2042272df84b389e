#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/progress.h"
#include "palpate/telemetry.h"
#include "palpate/volume.h"

/// A run on disk: HDF5 that opens in h5py and MATLAB, every input of every tick in it. docs/recording.md
/// documents the datasets. Holds no path, no header text and nothing else that could name a patient.
namespace palpate {

template <class T>
class SpscRing;

/// What is known before the first tick.
struct RecordingHeader {
  std::string palpate_version, commit, build_type, compiler;
  std::string simd_target;
  std::string started_utc;  ///< ISO 8601; wall clock, not part of the hash
  std::string data_set;     ///< catalogue name that replay can find by itself, or empty
  std::string scene_title;
  std::uint64_t model_hash = 0;
  std::uint32_t model_version = 1;
  double rate_hz = 1000;
  std::uint64_t seed = 0;
  std::string device, hand;  ///< of the simulation; empty for a real device
  bool simulated = true;
  int devices = 1;
  std::string clock = "virtual";  ///< or "real"
  std::string scheduler;          ///< what the servo thread got; empty on the virtual clock
  std::string script_text;        ///< the script as run
  struct Structure {
    LabelId label;
    std::string name, tissue;
    Rgb colour;
  };
  std::vector<Structure> structures;
};

/// How a version of the model follows from the one before it: a tissue was changed while it was felt, or the
/// direct methods' fields were made anew for the stiffnesses as they are.
struct ModelChange {
  static constexpr std::uint32_t kFieldsMadeAnew = 0xffffffff;
  std::uint32_t version = 0;  ///< one more than the version before it
  std::uint32_t tissue = 0;   ///< its place in the scene, from 0, or kFieldsMadeAnew
  // what the tissue has from that version on
  double stiffness_N_per_mm = 0, static_friction = 0, dynamic_friction = 0, viscosity_N_s_per_mm = 0;

  friend bool operator==(const ModelChange&, const ModelChange&) = default;
};

/// What is known after the last tick. A recording cut short has none.
struct RecordingSummary {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;  ///< over every tick's state hash, in order
  /// Ticks in which a device had the flag of that name, whose output was thus changed or withheld.
  std::uint64_t clamped = 0, not_finite = 0, outside = 0, paused = 0, rotation_ignored = 0, thermal = 0;
  std::uint64_t slewed = 0, stale = 0, jumped = 0, device_faults = 0, halted = 0, emergency_stopped = 0;
  std::uint64_t clutched = 0, faded = 0, blended = 0, method_missing = 0;
  std::uint64_t inside = 0, wedged = 0, ruptured = 0, passivated = 0;
  std::uint64_t dropped = 0;  ///< ticks that were computed and never reached the recorder: the ring was full
  std::uint64_t skipped = 0;  ///< points in time of the real clock that passed without a tick
  /// What the simulated hand did not reach, a sentence each. A recording keeps 1000 of them, the last of
  /// which then tells how many more there were, and 512 bytes of each.
  std::vector<std::string> trouble;
  /// How the model has changed, in the order of its versions. A recording keeps the first 100 000.
  std::vector<ModelChange> changes;

  /// Counts a tick, its flags, each once whatever the number of devices that have it, and its state hash.
  void see(const TickRecord& tick);
};

struct Recording {
  RecordingHeader header;
  std::vector<TickRecord> ticks;
  std::optional<RecordingSummary> summary;  ///< absent: the run was cut short
};

/// Mixes one tick's state hash into the run's.
std::uint64_t mix_run_hash(std::uint64_t run_hash, std::uint64_t state_hash);

/// Appends ticks to a file and flushes at least once per second of recorded time, so that a killed
/// program or a full disk loses at most the last second. Not for the servo thread.
class RecordingWriter {
 public:
  /// Replaces `file` by a recording without ticks, or leaves it as it is. Errors: kBadInput for a header
  /// that does not fit (devices, rate, texts above 4096 bytes, scripts above 16 MiB), kOutput.
  static Result<std::unique_ptr<RecordingWriter>> create(const std::filesystem::path& file,
                                                         const RecordingHeader& header);
  virtual ~RecordingWriter() = default;
  /// Every tick has the header's number of devices. Error kOutput when the disk is full or gone, now and
  /// at every later call; what was flushed before stays readable.
  virtual Result<void> append(std::span<const TickRecord> ticks) = 0;
  /// Flushes, writes the summary and closes: the last call but the destructor. Without it the destructor
  /// keeps all ticks, and the recording counts as cut short.
  virtual Result<void> finish(const RecordingSummary& summary) = 0;
};

/// Takes a run's ticks from a ring and writes them, on a thread of its own: what lies between the servo,
/// which waits for nobody, and a disk that lets everybody wait. Every few milliseconds it empties the ring,
/// so the ring must hold what comes in during the longest write.
class Recorder {
 public:
  /// @param ring  outlives the recorder, which is its one consumer
  /// @param file  as for RecordingWriter::create; empty: the ticks are counted and seen, and not kept
  /// @param see   called on the recorder's thread with every tick, in order; may be empty; throws nothing.
  ///              Its time adds to that of a write.
  /// Errors: those of RecordingWriter::create, kUnavailable when there is no thread to be had.
  static Result<std::unique_ptr<Recorder>> start(SpscRing<TickRecord>& ring,
                                                 const std::filesystem::path& file,
                                                 const RecordingHeader& header,
                                                 std::function<void(const TickRecord&)> see = {});
  /// Takes what is left in the ring and stops. A recording that was not finished counts as cut short.
  virtual ~Recorder() = default;
  /// Of the ticks taken so far; `dropped`, `skipped`, `trouble` and `changes` are finish()'s. Any thread.
  virtual RecordingSummary so_far() const = 0;
  /// Why the file stays as it was: the disk is full or gone. Ticks go on being taken, counted and seen. Any
  /// thread.
  virtual std::optional<Error> failure() const = 0;
  /// Takes what is left in the ring, writes the summary and closes: the last call but the destructor, when
  /// nothing is pushed any more. Fails with failure(), also when the last write is the one that fails.
  /// @param dropped, skipped  of the whole run, for the summary
  virtual Result<RecordingSummary> finish(std::uint64_t dropped, std::uint64_t skipped,
                                          const std::vector<std::string>& trouble,
                                          const std::vector<ModelChange>& changes = {}) = 0;
};

/// Reads a recording, a cut-short one up to its last whole flush, also while it is being written. Damaged
/// or foreign bytes, and recordings of an earlier format, are one clear error, never a crash: HDF5 runs in a
/// forked child process.
Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress = {});

}  // namespace palpate
