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
#include "palpate/tasks/motion.h"
#include "palpate/tasks/task.h"

/// A run is measured by a task: ticks in, what happened and metrics out. Never in the servo; what comes out
/// depends on the ticks alone, and hardly on how many there are a second.
///
/// The force on some structures is the sum of the normal forces of the contacts with them, in the patient;
/// where the structure that is touched first is one of them, with those of what lies beneath it: a meniscus
/// that is pressed against the cartilage below it bears all of the push. Between ticks a force counts as
/// straight.
namespace palpate {

struct TaskEvent {
  enum class Kind : std::uint8_t {
    kStepDone,   ///< `part` of the steps
    kOverLimit,  ///< the force on `part` of the forces passed its limit in this very tick
    kProtected,  ///< `part` of what is protected was touched above its limit, from this tick on
    kUnseen,     ///< what is touched first was not seen by the scope, from this tick on
    kEnded,      ///< the task was over
  };
  Kind kind = Kind::kStepDone;
  std::size_t part = 0;
  std::uint64_t tick = 0;
  double time_s = 0;   ///< since the first tick
  double force_N = 0;  ///< in that tick

  friend bool operator==(const TaskEvent&, const TaskEvent&) = default;
};
/// "step_done", as scores and viewers are told.
const char* kind_name(TaskEvent::Kind kind);

struct MetricValue {
  Metric metric = Metric::kTime;
  std::size_t part = 0;  ///< of the task's metrics
  /// NaN: the run has none (no contact, no motion, no answer); then it is in no band.
  double value = kNotKnown;
  bool counts = false, in_band = false;
};

struct TaskScore {
  std::vector<MetricValue> metrics;  ///< as TaskFile::metrics
  std::vector<bool> done;            ///< as TaskFile::steps
  /// The first 10 000, in the order of their ticks.
  std::vector<TaskEvent> events;
  std::uint64_t more_events = 0;  ///< beyond these
  std::uint64_t ticks = 0;        ///< that counted
  double time_s = 0;              ///< from the first of them to the last
  bool ended = false;             ///< by its steps or its time, before the recording did
  bool cut_short = false;         ///< the recording was
  double missing_s = 0;           ///< in gaps of more than one tick's number
  /// Every counted metric lies in its band, the run was not cut short, and no tick is missing.
  bool in_band = false;
  std::uint64_t hash = 0;  ///< of the task, the ticks' state hashes and every value, bit for bit
};

/// One device's run, tick by tick; the first device's where there are several.
class TaskEvaluator {
 public:
  explicit TaskEvaluator(TaskInScene task);

  /// Before the first tick: what was told before, of a task with a plan.
  void begin_after(const RemovalFollower& told) { gone_ = told; }
  /// What was told from outside, before the first tick that had heard of it.
  void hear(const RecordingEvent& event);
  /// Errors: kBadInput where a tick's time is not finite or does not grow, and for a run without the second
  /// device that holds the task's scope.
  Result<void> see(const TickRecord& tick);
  bool ended() const { return ended_; }
  /// @param cut_short  the recording was
  TaskScore score(bool cut_short) const;
  const TaskInScene& task() const { return task_; }

  // ---- how far it is
  std::uint64_t ticks() const { return ticks_; }
  /// Since the first tick.
  double time_s() const { return begun_ ? time_s_ - begun_s_ : 0; }
  double missing_s() const { return missing_s_; }
  const std::vector<bool>& done() const { return done_; }
  /// 0 ... 1: of a step's time without a break, or of what it asks to be covered; 1 once it was done.
  double share_of_step(std::size_t step) const;
  /// In the last tick, N: on a [[force]], on a [[protected]], on all that was touched.
  double force_N(std::size_t force) const { return forces_[force].last_N; }
  double protected_N(std::size_t protection) const { return protections_[protection].last_N; }
  double touch_N() const { return force_on({}); }
  /// In the last tick: something is touched that the task's scope does not see.
  bool touches_unseen() const { return unseen_; }
  /// Of the last tick that had a place, patient, mm.
  std::optional<Eigen::Vector3d> tip_mm() const { return tip_known_ ? std::optional(tip_mm_) : std::nullopt; }
  const std::vector<TaskEvent>& events() const { return events_; }
  std::uint64_t more_events() const { return more_events_; }
  /// The place that the trainee told, patient, mm, and the surface's outward normal there.
  struct Answer {
    Eigen::Vector3d place_mm, normal;
  };
  std::optional<Answer> answer() const {
    return answered_ ? std::optional(Answer{answer_mm_, answer_normal_}) : std::nullopt;
  }

 private:
  struct Contact {
    LabelId label = 0;
    Eigen::Vector3d place_mm = Eigen::Vector3d::Zero();
    double force_N = 0;
    bool is_beneath = false;  ///< what is touched, which it pushes back through
    bool is_seen = false;     ///< by the scope
  };
  /// A force over time, straight between ticks.
  struct ForceMeter {
    double contact_s = 0, impulse_Ns = 0, peak_N = 0, in_band_s = 0, excess_Ns = 0, above_s = 0;
    double unbroken_s = 0, longest_s = 0;
    double last_N = 0;
    void see(double force_N, double dt_s, const std::optional<std::array<double, 2>>& band_N,
             std::optional<double> limit_N);
  };

  /// Of what was taken off.
  struct Removal {
    double in_plan_mm3 = 0, outside_mm3 = 0, protected_mm3 = 0, past_plan_mm = 0;
  };

  void read_contacts(const TickRecord& tick);
  double force_on(const std::vector<bool>& labels) const;
  void see_forces(const TickRecord& tick, double dt_s);
  void see_steps(const TickRecord& tick, double dt_s);
  struct Share {
    double part = 0, asked = 0;
  };
  double touch_of_step(const TaskStep& step);
  std::optional<Share> share_asked(const TaskStep& step) const;
  void see_answer(const DeviceTick& device, double dt_s);
  void see_sight(const TickRecord& tick, double dt_s);
  void see_removal(const TickRecord& tick);
  Removal removal() const;
  void tell(TaskEvent::Kind kind, std::size_t part, const TickRecord& tick, double force_N);
  double value_of(std::size_t metric, const Removal& removal) const;
  double straight_mm() const;

  TaskInScene task_;
  MotionMeter motion_;
  std::array<Contact, kMaxContactsReported> contacts_;
  std::size_t contact_count_ = 0;
  std::vector<ForceMeter> forces_, protections_, metrics_;
  std::vector<double> step_s_;  // without a break, of each step
  std::vector<bool> step_was_met_, done_;
  std::vector<Eigen::Vector3d> corners_mm_;  // start, then where steps were done
  std::vector<TaskEvent> events_;
  std::uint64_t more_events_ = 0, ticks_ = 0, last_tick_ = 0, hash_;
  bool begun_ = false, ended_ = false;
  double begun_s_ = 0, time_s_ = 0, missing_s_ = 0;
  Eigen::Vector3d tip_mm_ = Eigen::Vector3d::Zero();
  bool tip_known_ = false;
  // of the answer
  Eigen::Vector3d anchor_mm_ = Eigen::Vector3d::Zero(), answer_mm_ = Eigen::Vector3d::Zero(),
                  answer_normal_ = Eigen::Vector3d::Zero();
  double rest_s_ = 0;
  bool resting_ = false, answered_ = false;
  // of the scope
  bool unseen_ = false;
  double unseen_s_ = 0;
  // of the plan: what is gone, and what of each region was when it was looked at last
  std::optional<RemovalFollower> gone_;
  std::vector<double> taken_mm3_;
  bool has_taken_ = true;
  double next_look_s_ = 0;
};

/// Of a recording the ticks of these numbers and between them: a run that was begun and ended while it was
/// made.
struct TickRange {
  std::uint64_t first = 0, last = std::numeric_limits<std::uint64_t>::max();
};

/// The ticks of a recording that are in a range, as a run, with what was told up to each of them.
class RunReader {
 public:
  explicit RunReader(TaskInScene task, const TickRange& range = {})
      : evaluator_(std::move(task)), range_(range) {}

  /// Those that come next. @param seen  called with each tick that is of the run, after it was seen; may be
  /// empty
  /// Errors: those of TaskEvaluator::see().
  Result<void> take(const RecordingPart& part, const std::function<void(const TickRecord&)>& seen = {});
  const TaskEvaluator& run() const { return evaluator_; }
  /// @param is_whole  the recording was not cut short
  TaskScore score(bool is_whole) const { return evaluator_.score(!is_whole && !has_last_); }

 private:
  TaskEvaluator evaluator_;
  TickRange range_;
  std::deque<RecordingEvent> told_;  // that no tick has heard of yet
  bool has_last_ = false;            // it goes as far as the range
};

/// A recording by a task. Errors: those of reading it, of look_up() and of TaskEvaluator::see(), with the
/// recording's name left to the caller; kBadInput where it has no tick of the range.
Result<TaskScore> score_recording(const TaskInScene& task, const RecordingSource& recording,
                                  const Progress& progress = {}, const TickRange& range = {});

/// Of runs in their order, how many at the end have every counted metric in its band, one after the other.
int runs_in_a_row(const std::vector<bool>& in_band);

/// Value with its unit: "2.81 N".
std::string metric_text(Metric metric, double value);
/// "at most 8.5", "at least 0.8", "2 ... 3.6", "" where it does not count.
std::string bounds_text(const TaskMetric& metric);
/// An event in words.
std::string event_text(const TaskFile& task, const TaskEvent& event);
/// Name of a metric with the structures that it is of: "peak_force of medial_meniscus".
std::string metric_name(const TaskMetric& metric);

}  // namespace palpate
