#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <list>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/telemetry.h"
#include "palpate/volume/volume.h"

/// Recording of a run: an HDF5 file, readable by h5py and MATLAB, that contains every input of every tick.
/// docs/reference/recording-layout.md documents the data sets. Contains no path, no header text of image
/// files and nothing else that could name a patient.
namespace palpate {

template <class T>
class SpscRing;

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
  /// haptic_settings_text() (palpate/servo/settings_tables.h); empty in older files without it
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

/// Log of external commands on their way to the recorder. The servo cannot store events, so each tick only
/// contains counters of the commands that it has acknowledged (TickRecord's model_version, solver_frame,
/// settings_number, arming_number), and the recorder determines each event's tick from them:
///
///    caller    append(): announced ── applied to the loop ── event stored ── announcement over
///    servo                                 └─ ticks with the next counter value ─► ring
///    recorder    ticks out of the ring ── wait for pending announcements ── events taken
///
/// An event is announced before a tick can acknowledge it, and stored before its announcement is over. A
/// thread that takes ticks first and then waits for the announcements therefore has every event that these
/// ticks acknowledge. Commands that overtake each other between two ticks are acknowledged by the same tick.
/// Thread-safe.
class EventLog {
 public:
  /// @param apply  carries the command out and returns its event, without the tick; empty if nothing was
  /// done. If it throws, no event is logged.
  void append(const std::function<std::optional<RecordingEvent>()>& apply);
  /// Appends the events since the last call to `rows`. Waits for pending announcements, which takes as long
  /// as a change of the loop's parameters or model.
  void take(std::list<RecordingEvent>& rows);

 private:
  std::mutex mutex_;  // guards the members below; not held while a command is applied
  std::condition_variable over_;
  std::list<std::uint64_t> announced_;  // numbers of pending announcements, ascending
  std::uint64_t announcements_ = 0;
  std::list<RecordingEvent> rows_;
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

/// Combines a tick's state hash with the run's hash.
std::uint64_t mix_run_hash(std::uint64_t run_hash, std::uint64_t state_hash);

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
  /// @param ring  outlives the recorder, which is its only consumer
  /// @param file  as for RecordingWriter::create; empty: ticks are counted and passed to `on_tick`, but not
  /// stored
  /// @param on_tick   called on the recorder's thread with every tick in order, and with the events that this
  /// tick is the first to acknowledge, as they are written; may be empty; must not throw. Its time adds to
  /// that of a write.
  /// @param log  log of external commands; outlives the recorder, its only consumer; may be null
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

/// Reads a whole recording into memory. Errors: those of RecordingSource.
Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress = {});

/// Names the first output of a device's tick that differs bitwise from the recorded one; empty if all are
/// equal. A recorded column that is 0 throughout may be missing in the file's format and is not compared.
std::string first_different_output(const DeviceTick& recorded, const DeviceTick& again);

}  // namespace palpate
