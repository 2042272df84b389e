#pragma once

#include <array>
#include <condition_variable>
#include <cstdint>
#include <deque>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <thread>
#include <vector>

#include "palpate/link/viewed_training.h"
#include "palpate/link/viewer_server.h"
#include "palpate/session/training.h"
#include "session/viewed_run.h"

namespace palpate {

/// A live session's tasks (palpate/session/training.h). Any thread; see() the recorder's alone.
class Training {
 public:
  /// Looks the tasks up. Errors: those of look_up(), where they have to fit; kInterrupted.
  /// @param model  with its surfaces
  /// @param devices  of the session: a task with a scope needs two
  static Result<std::unique_ptr<Training>> start(const TrainingOptions& options, const Model& model,
                                                 std::size_t devices, const Progress& progress);
  ~Training() { end(); }
  Training(const Training&) = delete;
  Training& operator=(const Training&) = delete;

  const std::vector<ViewedTask>& tasks() const { return viewed_; }
  /// Before the first tick.
  void begin_session(const RecordingHeader& header);
  /// A tick, and what it is the first one to have heard of. Throws nothing.
  void see(const TickRecord& tick, std::span<const RecordingEvent> told = {}) noexcept;
  /// What is under way ends, and all that is over has been kept. Nothing is seen any more.
  void end();

  /// Errors: kBadInput for a name that no task has, kUsage where a run is under way or the last one is being
  /// kept, where something is taken off already of which the task has a plan, and where a lesson is of
  /// another task. @param learner  whose it is; empty: that of the session or of the lesson
  Result<void> begin(const std::string& task, const std::string& learner = "");
  /// Error kUsage where none is under way.
  Result<void> end_run();
  /// Ends the run that is under way, else begins the task that was done last, or the first.
  Result<void> begin_or_end();

  /// Whose the runs are from now on, and which task alone may be begun. Errors: kUsage while a run is under
  /// way and for a task that there is not; those of check_learner.
  Result<void> teach(const LessonRequest& request);
  ViewedState::Lesson lesson() const;
  /// Those of TrainingOptions.
  bool keeps_runs() const { return static_cast<bool>(options_.curves); }
  Result<std::string> curves(const std::string& learner) const { return options_.curves(learner); }

  ViewedTraining state() const;
  std::shared_ptr<const ViewedDebriefing> debriefing() const;
  /// Those that are over and kept, in their order, without the first so many.
  std::vector<FinishedRun> finished(std::size_t but = 0) const;

 private:
  struct Live {
    std::size_t task;
    std::uint32_t number;
    TaskEvaluator evaluator;
    RunTrace trace;
    TickRange ticks{0, 0};
    std::uint64_t run_hash;
    std::string learner;
  };

  Training(TrainingOptions options, std::vector<TaskInScene> in_scene, std::vector<ViewedTask> viewed);
  void over(RunEnd end);
  ViewedTraining seen(const Live& live) const;
  bool keeps(const std::string& learner) const { return options_.over && !learner.empty(); }
  void keep();

  TrainingOptions options_;
  std::vector<TaskInScene> in_scene_;
  std::vector<ViewedTask> viewed_;

  mutable std::mutex mutex_;  // of what follows
  std::condition_variable changed_;
  std::shared_ptr<const RecordingHeader> header_;
  std::optional<RemovalFollower> gone_;  // where a task has a plan
  std::unique_ptr<Live> live_;
  struct Over {
    std::unique_ptr<Live> live;
    TaskRun run;
  };
  std::deque<Over> over_;  // to be kept
  bool keeping_ = false, ending_ = false;
  std::uint32_t runs_ = 0;
  std::size_t last_task_ = 0;
  ViewedState::Lesson lesson_;
  ViewedTraining state_;  // of a run that is not under way
  std::shared_ptr<const ViewedDebriefing> debriefing_;
  std::vector<FinishedRun> finished_;
  std::thread keeper_;
};

}  // namespace palpate
