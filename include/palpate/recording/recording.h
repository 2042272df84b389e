#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "palpate/device/model_change.h"
#include "palpate/device/sweep_record.h"
#include "palpate/device/telemetry.h"
#include "palpate/volume/volume.h"

/// Recording of a run: an HDF5 file, readable by h5py and MATLAB, that contains every input of every tick.
/// docs/reference/recording-layout.md documents the data sets. Contains no path, no header text of image
/// files and nothing else that could name a patient.
namespace palpate {

/// Task of which a recording is a run, as declared at its beginning.
struct RecordedTask {
  /// Name in `palpate task list`; for a user's file its title; empty: none
  std::string name;
  std::uint64_t hash = 0;  ///< TaskFile::text_hash
  std::string seed;        ///< Seed by which `palpate task draw` draws this data set; empty: none
  friend bool operator==(const RecordedTask&, const RecordedTask&) = default;
};

/// Data known before the first tick.
struct RecordingHeader {
  std::string palpate_version, commit, build_type, compiler;
  std::string simd_target;
  std::string started_utc;  ///< ISO 8601; wall clock, not part of the hash
  std::string data_set;     ///< Catalogue name by which replay finds the data set; may be empty
  std::string scene_title;
  std::uint64_t model_hash = 0;
  std::uint32_t model_version = 1;
  double rate_hz = 1000;
  std::uint64_t seed = 0;
  std::string device, hand;  ///< Simulated device and hand; empty for a physical device
  bool simulated = true;
  int devices = 1;
  std::string clock = "virtual";  ///< "virtual" or "real"
  std::string scheduler;          ///< Scheduling of the servo thread; empty on the virtual clock
  double tissue_cell_factor = 1;  ///< Model::tissue_cell_factor; 1 in older files without it
  /// haptic_settings_text() (palpate/servo/haptic_settings.h); empty in older files without it
  std::string haptic_settings;
  RecordedTask task;        ///< Empty in older files without it
  std::string script_text;  ///< Text of the script
  struct Structure {
    LabelId label;
    std::string name, tissue;
    Rgb colour;
  };
  std::vector<Structure> structures;
};

/// Originator of an external command to a run.
enum class Originator : std::uint8_t {
  kSession,            ///< The session itself
  kScript,             ///< The simulated hand's script
  kKey,                ///< A key where palpate runs
  kControlViewer,      ///< A viewer with permission to change things
  kViewingViewer,      ///< A viewer that may only look and stop
  kViewerWithConsent,  ///< A viewer with permission, with consent given by a key where palpate runs
};
struct RequestedBy {
  Originator originator = Originator::kSession;
  std::uint32_t viewer = 0;  ///< Number of the viewer, from 1 in the order of their hellos; 0: none

  friend bool operator==(const RequestedBy&, const RequestedBy&) = default;
};

/// External command to a run, with the tick in which it took effect.
struct RecordingEvent {
  enum class Kind : std::uint8_t {
    kModel,           ///< A new model version: `change`
    kSettings,        ///< `changed` ... `rotation_target_wxyz`
    kStop,            ///< Emergency stop: forces off immediately
    kRearm,           ///< Forces ramped up again
    kSweep,           ///< A burr's sweep, one of those removed in the model version `number`: `sweep`
    kTissueSolution,  ///< A solution of deforming tissue: frame `number` (ComplianceFrame), `input_tick`,
                      ///< `frame_hash`
  };
  /// First recorded tick that acknowledges it: the tick in which it took effect, unless ticks are missing.
  std::uint64_t tick = 0;
  Kind kind = Kind::kModel;
  RequestedBy by;
  /// kModel: the resulting version; kTissueSolution: the frame; otherwise an ordinal from 1, counted over
  /// settings, and over stops and rearms together.
  std::uint32_t number = 0;
  ModelChange change;  ///< ModelChange with version `number`
  // Settings in effect from then on, as in TickRecord. If several requests preceded one tick, each row
  // contains the result of all of them.
  std::uint16_t changed = 0;  ///< SettingBit bits; 0: the request asked for the current values
  std::uint8_t method = 0, switches = 0;
  double max_force_N = 0;
  std::array<double, 4> rotation_target_wxyz{1, 0, 0, 0};
  SweepRecord sweep;
  std::uint64_t input_tick = 0;  ///< kTissueSolution: tick from which it was solved
  /// kTissueSolution: ComplianceFrame::hash of the result, or kUnsolved.
  std::uint64_t frame_hash = 0;
  /// The frame could not be solved because memory ran out: every LocalCompliance in it is unknown, and the
  /// solver was restarted after it.
  static constexpr std::uint64_t kUnsolved = 0;

  friend bool operator==(const RecordingEvent&, const RecordingEvent&) = default;
};

/// Totals known after the last tick. Absent in an incomplete recording.
struct RecordingSummary {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;  ///< Hash over every tick's state hash, in order
  /// Number of ticks in which at least one device had the TickFlag of that name; `ramped` counts kFlagRamp,
  /// `passivated` kFlagPassivity and `rotation_limited` kFlagRotationLimited.
  std::uint64_t clamped = 0, not_finite = 0, outside = 0, paused = 0, rotation_ignored = 0, thermal = 0;
  std::uint64_t slewed = 0, stale = 0, jumped = 0, device_faults = 0, halted = 0, emergency_stopped = 0;
  std::uint64_t clutched = 0, ramped = 0, blended = 0, method_missing = 0;
  std::uint64_t inside = 0, wedged = 0, ruptured = 0, passivated = 0, rotation_limited = 0;
  std::uint64_t dropped = 0;  ///< Ticks that were computed but lost because the ring was full
  std::uint64_t skipped = 0;  ///< Nominal tick times of the real clock that passed without a tick
  /// Targets that the simulated hand missed, one sentence each. A recording stores at most 1000, the last of
  /// which then gives the number of omitted ones, and 512 bytes of each.
  std::vector<std::string> problems;

  /// Adds a tick: its flags, each counted once per tick regardless of the number of devices, and its state
  /// hash.
  void observe(const TickRecord& tick);
};

/// Recording in memory, 1.8 kB per tick: for a few minutes.
struct Recording {
  RecordingHeader header;
  std::vector<TickRecord> ticks;
  std::vector<RecordingEvent> events;       ///< Ascending by tick
  std::optional<RecordingSummary> summary;  ///< Absent: the recording is incomplete
};

/// Data of a recording available without reading its ticks.
struct RecordingHead {
  RecordingHeader header;
  std::optional<RecordingSummary> summary;  ///< Absent: the recording is incomplete
  std::uint64_t ticks = 0;                  ///< Number of ticks
  bool is_clock_monotonic = true;           ///< Whether time_s is finite and strictly increasing
  struct AppliedMethod {
    std::uint8_t method = 0;  ///< Method as in TickRecord
    std::uint64_t tick = 0;   ///< First tick that used it
  };
  std::vector<AppliedMethod> methods;  ///< Force methods used, in the order of their first ticks
};

/// Combines a tick's state hash with the run's hash.
std::uint64_t mix_run_hash(std::uint64_t run_hash, std::uint64_t state_hash);

}  // namespace palpate
