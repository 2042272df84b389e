#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <functional>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/telemetry.h"
#include "palpate/recording/recording.h"
#include "palpate/recording/recording_source.h"
#include "palpate/tasks/burr_meters.h"
#include "palpate/tasks/motion.h"
#include "palpate/tasks/task.h"

/// Evaluates a run against a task: consumes ticks and produces events and metrics. It does not run in the
/// servo loop. The result depends only on the ticks, and only weakly on their rate.
///
/// The force on a set of structures is the sum of the normal forces of the contacts with them, as sent to the
/// device: the contact model's forces times the device's force gain, all scaled by one factor so that their
/// sum does not exceed the magnitude of the force that was sent. A force that was limited, faded out or
/// withheld is therefore counted as sent, and no figure exceeds the force limit. If the outermost contact is
/// with one of the structures, contacts beneath it are included: a meniscus that is pressed against the
/// cartilage below it bears the whole load. Forces are interpolated linearly between ticks.
namespace palpate {

/// An event in a run.
struct TaskEvent {
  enum class Kind : std::uint8_t {
    kStepDone,   ///< Step number `part` was completed
    kOverLimit,  ///< Force number `part` rose above its limit in this tick
    kProtected,  ///< Protected structure number `part` was touched with more than its limit; first tick
    kUnseen,     ///< The outermost contact became invisible to the scope; first tick
    kEnded,      ///< The task ended
  };
  Kind kind = Kind::kStepDone;
  std::size_t part = 0;
  std::uint64_t tick = 0;
  double time_s = 0;   ///< Since the first tick
  double force_N = 0;  ///< Force in that tick

  friend bool operator==(const TaskEvent&, const TaskEvent&) = default;
};
/// Name in scores and in the viewer protocol, e.g. "step_done".
const char* kind_name(TaskEvent::Kind kind);

/// Value of a graded or displayed metric.
struct MetricValue {
  Metric metric = Metric::kTime;
  std::size_t part = 0;  ///< Index into the task's metrics
  /// NaN: not available (no contact, no motion, no answer), which is outside every band.
  double value = kNoValue;
  /// Whether it is graded, and whether it is within its band.
  bool counts = false, in_band = false;
};

/// Result of a run.
struct TaskScore {
  std::vector<MetricValue> metrics;  ///< Value of each metric, in the order of TaskFile::metrics
  std::vector<bool> done;            ///< Whether each step was completed, in the order of TaskFile::steps
  /// Events in the order of their ticks, at most the first 10 000.
  std::vector<TaskEvent> events;
  std::uint64_t more_events = 0;  ///< Number of events beyond these
  std::uint64_t ticks = 0;        ///< Number of ticks evaluated
  double started_s = 0;           ///< Time of the first of them in the recording (TickRecord::time_s)
  double time_s = 0;              ///< Duration from the first to the last of them
  /// Whether the run ended by its steps or its time limit, before the end of the recording
  bool ended = false;
  bool cut_short = false;  ///< Whether the recording is truncated
  double missing_s = 0;    ///< Total duration of gaps in the tick numbers
  /// Whether every graded metric is in its band, the run is not truncated, and no tick is missing.
  bool in_band = false;
  std::uint64_t hash = 0;  ///< Hash of the task, the ticks' state hashes and every value, bit for bit
};

/// Evaluator of one run, tick by tick. With several devices the first one performs the task.
class TaskEvaluator {
 public:
  explicit TaskEvaluator(TaskInScene task);

  /// Sets the tissue already removed before the first tick, for a task with a plan.
  void set_initial_removal(const RemovalFollower& reported) { removed_ = reported; }
  /// Processes an event of the recording; call it before the first tick that follows the event.
  void on_event(const RecordingEvent& event);
  /// Processes a tick. Errors: kBadInput if the tick's time is not finite or does not increase, or if the
  /// second device, which holds the task's scope, is missing.
  Result<void> observe(const TickRecord& tick);
  bool ended() const { return ended_; }
  /// @param cut_short  whether the recording is truncated
  TaskScore score(bool cut_short) const;
  const TaskInScene& task() const { return task_; }

  // ---- progress
  std::uint64_t ticks() const { return ticks_; }
  /// Time since the first tick.
  double time_s() const { return begun_ ? time_s_ - started_s_ : 0; }
  double missing_s() const { return missing_s_; }
  const std::vector<bool>& done() const { return done_; }
  /// Progress of a step, 0 ... 1: fraction of the uninterrupted time, or of the required coverage or removal;
  /// 1 once completed.
  double fraction_of_step(std::size_t step) const;
  /// Forces in the last tick, N: on a [[force]], on a [[protected]], and the total contact force.
  double force_N(std::size_t force) const { return force_meters_[force].last_N; }
  double protected_N(std::size_t protection) const { return protection_meters_[protection].last_N; }
  double touch_N() const { return force_on({}); }
  /// Whether the outermost contact of the last tick is invisible to the task's scope.
  bool touches_invisible() const { return unseen_; }
  /// Last valid tip position, patient frame, mm.
  std::optional<Eigen::Vector3d> tip_mm() const { return tip_known_ ? std::optional(tip_mm_) : std::nullopt; }
  const std::vector<TaskEvent>& events() const { return events_; }
  std::uint64_t more_events() const { return more_events_; }
  /// Location reported by the trainee, patient frame, mm, and the outward surface normal there.
  struct Answer {
    Eigen::Vector3d position_mm, normal;
  };
  std::optional<Answer> answer() const {
    return answered_ ? std::optional(Answer{answer_mm_, answer_normal_}) : std::nullopt;
  }

 private:
  struct Contact {
    LabelId label = 0;
    Eigen::Vector3d position_mm = Eigen::Vector3d::Zero();
    double force_N = 0;       ///< As sent to the device
    bool is_beneath = false;  ///< Whether it is beneath the outermost contact, which transmits its load
    bool is_visible = false;  ///< Visible through the scope
  };
  /// Integrals of a force over time, linearly interpolated between ticks.
  struct ForceMeter {
    double contact_s = 0, impulse_Ns = 0, peak_N = 0, in_band_s = 0, excess_Ns = 0, above_s = 0;
    double unbroken_s = 0, longest_s = 0;
    double last_N = 0;
    void observe(double force_N, double dt_s, const std::optional<std::array<double, 2>>& band_N,
                 std::optional<double> limit_N);
  };

  /// Volumes of removed tissue, and the depth beyond the plan.
  struct Removal {
    double in_plan_mm3 = 0, outside_mm3 = 0, protected_mm3 = 0, past_plan_mm = 0;
  };

  /// Touch of the region of a kCover step: its contacts, without a break, of at least kMinTouch_N.
  struct CoverageTouch {
    bool touching = false;
    bool moving = false;  ///< Whether it has moved far enough along the surface to count
    Eigen::Vector3d started_mm = Eigen::Vector3d::Zero();
  };
  /// Place at which a kTouch step was completed: until contact breaks there or leaves it, it completes no
  /// step on another region.
  struct CompletedTouch {
    Eigen::Vector3d position_mm;
    std::size_t region;
  };

  void read_contacts(const TickRecord& tick);
  const Contact* strongest_contact() const;
  double force_on(const std::vector<bool>& labels) const;
  void update_forces(const TickRecord& tick, double dt_s);
  void update_steps(const TickRecord& tick, double dt_s);
  struct StepProgress {
    double achieved = 0, required = 0;
  };
  double force_on_step(const TaskStep& step) const;
  bool is_on_step(const Contact& contact, const TaskStep& step) const;
  void cover_patches(std::size_t step);
  bool belongs_to_completed_touch(const TaskStep& step) const;
  std::optional<StepProgress> progress_of(const TaskStep& step) const;
  void update_answer(const DeviceTick& device, double dt_s);
  void update_visibility(const TickRecord& tick, double dt_s);
  void update_removal(const TickRecord& tick);
  void update_burr(const TickRecord& tick, double dt_s);
  Removal removal() const;
  void add_event(TaskEvent::Kind kind, std::size_t part, const TickRecord& tick, double force_N);
  double value_of(std::size_t metric, const Removal& removal) const;
  double shortest_path_mm() const;

  TaskInScene task_;
  MotionMeter motion_;
  std::array<Contact, kMaxContactsReported> contacts_;
  std::size_t contact_count_ = 0;
  std::vector<ForceMeter> force_meters_, protection_meters_, metric_meters_;
  std::vector<double> step_s_;                   // uninterrupted time of each step
  std::vector<CoverageTouch> coverage_touches_;  // one for each step; used by kCover
  std::optional<CompletedTouch> last_completed_touch_;
  std::vector<bool> step_condition_held_, done_;
  std::vector<Eigen::Vector3d> waypoints_mm_;  // tip positions at the start and where steps were completed
  std::vector<TaskEvent> events_;
  std::uint64_t more_events_ = 0, ticks_ = 0, last_tick_ = 0, hash_;
  bool begun_ = false, ended_ = false;
  double started_s_ = 0, time_s_ = 0, missing_s_ = 0;
  Eigen::Vector3d tip_mm_ = Eigen::Vector3d::Zero();
  bool tip_known_ = false;
  // answer
  Eigen::Vector3d anchor_mm_ = Eigen::Vector3d::Zero(), answer_mm_ = Eigen::Vector3d::Zero(),
                  answer_normal_ = Eigen::Vector3d::Zero();
  double rest_s_ = 0;
  bool resting_ = false, answered_ = false;
  // scope
  bool unseen_ = false;
  double unseen_s_ = 0;
  // plan: removed tissue, and the volume removed of each region at the last evaluation
  std::optional<RemovalFollower> removed_;
  std::vector<double> removed_mm3_;
  bool removal_changed_ = true;
  double next_check_s_ = 0;
  // burr: one for each metric of a burr near structures
  std::vector<std::optional<BurrNearStructures>> burr_meters_;
  bool hidden_ = false;
  double hidden_s_ = 0, next_look_s_ = 0;
};

/// Range of tick numbers of a recording, for a run that was started and ended while recording.
struct TickRange {
  std::uint64_t first = 0, last = std::numeric_limits<std::uint64_t>::max();
};

/// Evaluates the ticks of a recording within a range, together with the events up to each of them.
class RunReader {
 public:
  explicit RunReader(TaskInScene task, const TickRange& range = {})
      : evaluator_(std::move(task)), range_(range) {}

  /// Processes the next part of the recording.
  /// @param on_tick  called after each evaluated tick; may be empty
  /// Errors: those of TaskEvaluator::observe().
  Result<void> take(const RecordingPart& part, const std::function<void(const TickRecord&)>& on_tick = {});
  const TaskEvaluator& run() const { return evaluator_; }
  /// @param is_whole  whether the recording is complete
  TaskScore score(bool is_whole) const { return evaluator_.score(!is_whole && !has_last_); }

 private:
  TaskEvaluator evaluator_;
  TickRange range_;
  std::deque<RecordingEvent> pending_events_;  // not yet followed by a tick
  bool has_last_ = false;                      // the recording reaches the end of the range
};

/// Scores a recording against a task. Errors: those of reading it, of resolve_task() and of
/// TaskEvaluator::observe(), to which the caller adds the recording's name; kBadInput if it has no tick in
/// the range.
Result<TaskScore> score_recording(const TaskInScene& task, const RecordingSource& recording,
                                  const Progress& progress = {}, const TickRange& range = {});

/// Number of consecutive runs at the end of the list with every graded metric in its band.
int runs_in_a_row(const std::vector<bool>& in_band);

/// Value with unit: "2.81 N".
std::string metric_text(Metric metric, double value);
/// Band as text: "at most 8.5", "at least 0.8", "2 ... 3.6", "" if not graded.
std::string bounds_text(const TaskMetric& metric);
/// Event as a sentence.
std::string event_text(const TaskFile& task, const TaskEvent& event);
/// Name of a metric with its structures: "peak_force of medial_meniscus".
std::string metric_name(const TaskMetric& metric);

}  // namespace palpate
