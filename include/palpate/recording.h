#pragma once

#include <cstdint>
#include <filesystem>
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
  std::string script_text;  ///< the script as run
  struct Structure {
    LabelId label;
    std::string name, tissue;
    Rgb colour;
  };
  std::vector<Structure> structures;
};

/// What is known after the last tick. A recording cut short has none.
struct RecordingSummary {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;  ///< over every tick's state hash, in order
  std::uint64_t clamped = 0, not_finite = 0, outside = 0, paused = 0;
  /// What the simulated hand did not reach, a sentence each. A recording keeps 1000 of them, the last of
  /// which then tells how many more there were, and 512 bytes of each.
  std::vector<std::string> trouble;
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

/// Reads a recording, a cut-short one up to its last whole flush, also while it is being written. Damaged
/// or foreign bytes are one clear error, never a crash: HDF5 runs in a forked child process.
Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress = {});

}  // namespace palpate
