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

/// A run on disk: HDF5 that opens in h5py and MATLAB, every input of every tick in it.
/// docs/reference/recording-layout.md documents the data sets. Holds no path, no header text and nothing else
/// that could name a patient.
namespace palpate {

template <class T>
class SpscRing;

/// What is known before the first tick.
/// Of which task a recording is a run, as it was said when it began.
struct RecordedTask {
  /// By which palpate task list has it; of a file of the user's its title; empty: of none.
  std::string name;
  std::uint64_t hash = 0;  ///< TaskFile::text_hash
  std::string seed;        ///< by which palpate task draw draws this data set; empty: by none
  friend bool operator==(const RecordedTask&, const RecordedTask&) = default;
};

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
  double tissue_coarsened = 1;    ///< Model::tissue_coarsened; 1 in files from before it was told
  std::string feel;         ///< feel_text() (palpate/servo/feel.h); empty in files from before it was told
  RecordedTask task;        ///< none in files from before it was told
  std::string script_text;  ///< the script as run
  struct Structure {
    LabelId label;
    std::string name, tissue;
    Rgb colour;
  };
  std::vector<Structure> structures;
};

/// Who asked for something that a run was told from outside.
enum class Asker : std::uint8_t {
  kSession,        ///< nobody: the session by itself
  kScript,         ///< the simulated hand's script
  kKey,            ///< a key where palpate runs
  kControlViewer,  ///< a viewer that may change things
  kLookingViewer,  ///< a viewer that may look, and stop
  kAgreedViewer,   ///< a viewer that may change things, agreed to by a key where palpate runs
};
struct AskedBy {
  Asker asker = Asker::kSession;
  std::uint32_t viewer = 0;  ///< which viewer, from 1 in the order in which they said hello; 0: none

  friend bool operator==(const AskedBy&, const AskedBy&) = default;
};

/// What a settings request changed. Bits of RecordingEvent::changed.
enum SettingBit : std::uint8_t {
  kSettingMethod = 1u << 0,
  kSettingFriction = 1u << 1,
  kSettingViscosity = 1u << 2,
  kSettingPassivity = 1u << 3,
  kSettingPaused = 1u << 4,
  kSettingMaxForce = 1u << 5,
  kSettingRotation = 1u << 6,
  kSettingPointer = 1u << 7,  ///< a viewer took the tip, or left it: in turns, for one at a time has it
};

/// Something that a run was told from outside, and the tick in which it took hold.
struct RecordingEvent {
  enum class Kind : std::uint8_t {
    kModel,     ///< the model became its next version: `change`
    kSettings,  ///< `changed` ... `rotation_wxyz`
    kStop,      ///< emergency stop: forces off at once
    kRearm,     ///< forces on again, by the ramp
    kSweep,     ///< a burr's sweep, of those that the model's version `number` is cut by: `sweep`
    kMotor,     ///< as kSettings, and the tool's motor was switched on or off
    kYield,     ///< tissue that yields was solved: frame `number` (YieldFrame), `input_tick`, `frame_hash`
  };
  /// The first recorded tick that had heard of it: the one in which it took hold, where none is missing.
  std::uint64_t tick = 0;
  Kind kind = Kind::kModel;
  AskedBy by;
  /// Of the model the version that it became; of a solution the frame; of settings, and of stops and rearms
  /// together, their place in that order, from 1.
  std::uint32_t number = 0;
  ModelChange change;  ///< its version is `number`
  // the settings as they were from then on, as in TickRecord; what several requests changed before one tick
  // felt them stands in each row
  std::uint8_t changed = 0;  ///< SettingBit bits; none: it was asked for what held already
  std::uint8_t method = 0, switches = 0;
  double max_force_N = 0;
  std::array<double, 4> rotation_wxyz{1, 0, 0, 0};
  SweepRecord sweep;
  std::uint64_t input_tick = 0;  ///< of a solution: the tick that it was made from
  std::uint64_t frame_hash = 0;  ///< what it came to (YieldFrame::hash)

  friend bool operator==(const RecordingEvent&, const RecordingEvent&) = default;
};

/// What a session is told from outside, on its way to the recorder. The servo can keep no row, so a tick only
/// says by numbers up to what it has heard (TickRecord's model_version, yield_frame, settings_number,
/// arming_number), and the recorder finds each row's tick:
///
///     who asks    tell(): announced ── done in the loop ── row kept ── announcement over
///     servo                                 └─ ticks with the next number ─► ring
///     recorder    ticks out of the ring ── announcements until now are over ── rows taken
///
/// A row is announced before a tick can hear of it and kept before the announcement is over, so whoever
/// waits for the announcements after he took the ticks has every row that these had heard of. Requests that
/// overtake each other before a tick looks are heard of by the same tick. Any thread.
class EventLog {
 public:
  /// @param apply  does what is asked and returns the row, without its tick; nothing where nothing was done.
  ///               Where it throws there is no row.
  void tell(const std::function<std::optional<RecordingEvent>()>& apply);
  /// The rows since the last time go to the end of `rows`. Waits for those that are announced, which takes
  /// as long as a change of the loop's parameters or model.
  void take(std::list<RecordingEvent>& rows);

 private:
  std::mutex mutex_;  // of what follows; not held while anything is done
  std::condition_variable over_;
  std::list<std::uint64_t> announced_;  // numbers, in order
  std::uint64_t announcements_ = 0;
  std::list<RecordingEvent> rows_;
};

/// What is known after the last tick. A recording cut short has none.
struct RecordingSummary {
  std::uint64_t ticks = 0;
  std::uint64_t run_hash = 0;  ///< over every tick's state hash, in order
  /// Ticks in which a device had the flag of that name, whose output was thus changed or withheld.
  std::uint64_t clamped = 0, not_finite = 0, outside = 0, paused = 0, rotation_ignored = 0, thermal = 0;
  std::uint64_t slewed = 0, stale = 0, jumped = 0, device_faults = 0, halted = 0, emergency_stopped = 0;
  std::uint64_t clutched = 0, faded = 0, blended = 0, method_missing = 0;
  std::uint64_t inside = 0, wedged = 0, ruptured = 0, passivated = 0, turns_held = 0;
  std::uint64_t dropped = 0;  ///< ticks that were computed and never reached the recorder: the ring was full
  std::uint64_t skipped = 0;  ///< points in time of the real clock that passed without a tick
  /// What the simulated hand did not reach, a sentence each. A recording keeps 1000 of them, the last of
  /// which then tells how many more there were, and 512 bytes of each.
  std::vector<std::string> trouble;

  /// Counts a tick, its flags, each once whatever the number of devices that have it, and its state hash.
  void see(const TickRecord& tick);
};

/// A recording in memory, 1.8 kB a tick: for a few minutes.
struct Recording {
  RecordingHeader header;
  std::vector<TickRecord> ticks;
  std::vector<RecordingEvent> events;       ///< in the order of their ticks
  std::optional<RecordingSummary> summary;  ///< absent: the run was cut short
};

/// What there is to know of a recording before its ticks are read.
struct RecordingHead {
  RecordingHeader header;
  std::optional<RecordingSummary> summary;  ///< absent: the run was cut short
  std::uint64_t ticks = 0;                  ///< that it holds
  bool clock_rises = true;                  ///< time_s is finite and grows from tick to tick
  struct FeltMethod {
    std::uint8_t method = 0;  ///< as in TickRecord
    std::uint64_t tick = 0;   ///< the first one that felt it
  };
  std::vector<FeltMethod> methods;  ///< that were felt, in the order of their first ticks
};

/// Some ticks in a row with what was told up to them: a model's change comes with or before the first tick
/// that felt it. Either may be empty.
struct RecordingPart {
  std::span<const TickRecord> ticks;
  std::span<const RecordingEvent> events;
};

/// A recording to be read from its beginning to its end, as often as one likes, in memory that does not
/// depend on its length.
class RecordingSource {
 public:
  /// A cut-short one up to its last whole flush, also while it is being written: then as far as it was
  /// now. Damaged or foreign bytes, and recordings of formats that are not read, are one clear error, never a
  /// crash: HDF5 runs in a process of its own, a copy of the program that can do nothing else. It is to be
  /// read where a servo does not tick; volume_io.h says what the copy costs.
  static Result<RecordingSource> open(const std::filesystem::path& file, const Progress& progress = {});
  /// What is in memory already, which outlives the source.
  RecordingSource(const Recording& recording);  // NOLINT(google-explicit-constructor): it is one

  const RecordingHead& head() const { return head_; }
  /// Everything in order, head().ticks ticks in all. `take` may end it by an error, which is then that of
  /// read(). Errors: those of open(), kInterrupted, kBadInput where another file has taken the place of the
  /// one that was opened.
  Result<void> read(const std::function<Result<void>(const RecordingPart&)>& take,
                    const Progress& progress = {}) const;
  /// Ticks in a row, as many as there are of `count` from the one in row `first` on, 0 the first. It takes as
  /// long at any place. Errors: those of read().
  Result<std::vector<TickRecord>> read_at(std::uint64_t first, std::uint64_t count,
                                          const Progress& progress = {}) const;

 private:
  RecordingSource(std::filesystem::path file, RecordingHead head)
      : file_(std::move(file)), head_(std::move(head)) {}

  std::filesystem::path file_;
  const Recording* memory_ = nullptr;
  RecordingHead head_;
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
  /// @param events  of these ticks, in their order; in the file before the first tick that heard of them
  virtual Result<void> append(std::span<const TickRecord> ticks,
                              std::span<const RecordingEvent> events = {}) = 0;
  /// Flushes, writes the summary and closes: the last call but the destructor. Without it the destructor
  /// keeps all ticks, and the recording counts as cut short.
  virtual Result<void> finish(const RecordingSummary& summary) = 0;
};

/// Takes a run's ticks from a ring and writes them, on a thread of its own: what lies between the servo,
/// which waits for nobody, and a disk that lets everybody wait. Every few milliseconds it empties the ring,
/// so the ring must hold what comes in during the longest write.
class Recorder {
 public:
  using See = std::function<void(const TickRecord&, std::span<const RecordingEvent>)>;
  /// @param ring  outlives the recorder, which is its one consumer
  /// @param file  as for RecordingWriter::create; empty: the ticks are counted and seen, and not kept
  /// @param see   called on the recorder's thread with every tick, in order, and with the rows that this is
  ///              the first one to have heard of, as they are written; may be empty; throws nothing. Its time
  ///              adds to that of a write.
  /// @param told  what the run is told from outside; outlives the recorder, which alone takes from it; may be
  ///              null
  /// Errors: those of RecordingWriter::create, kUnavailable when there is no thread to be had.
  static Result<std::unique_ptr<Recorder>> start(SpscRing<TickRecord>& ring,
                                                 const std::filesystem::path& file,
                                                 const RecordingHeader& header, See see = {},
                                                 EventLog* told = nullptr);
  /// Takes what is left in the ring and stops. A recording that was not finished counts as cut short.
  virtual ~Recorder() = default;
  /// Of the ticks taken so far; `dropped`, `skipped` and `trouble` are finish()'s. Any thread.
  virtual RecordingSummary so_far() const = 0;
  /// Why the file stays as it was: the disk is full or gone. Ticks go on being taken, counted and seen. Any
  /// thread.
  virtual std::optional<Error> failure() const = 0;
  /// Takes what is left in the ring, writes the summary and closes: the last call but the destructor, when
  /// nothing is pushed any more. Fails with failure(), also when the last write is the one that fails.
  /// @param dropped, skipped  of the whole run, for the summary
  virtual Result<RecordingSummary> finish(std::uint64_t dropped, std::uint64_t skipped,
                                          const std::vector<std::string>& trouble) = 0;
};

/// All of a recording in memory. Errors: those of RecordingSource.
Result<Recording> read_recording(const std::filesystem::path& file, const Progress& progress = {});

/// Of a device's tick the first output that is not the recorded one, bit for bit, in words; empty: they are
/// the same. A column that is 0 throughout may be one that the recording does not have yet, and is not
/// compared.
std::string first_different_output(const DeviceTick& recorded, const DeviceTick& again);

}  // namespace palpate
