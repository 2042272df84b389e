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

#include "palpate/server/viewed_training.h"
#include "palpate/server/viewer_host.h"
#include "palpate/session/training.h"
#include "session/viewed_run.h"

namespace palpate {

/// Tasks of a live session (palpate/session/training.h). Thread-safe, except that observe() is called by the
/// recorder's thread only.
class Training {
 public:
  /// Looks the tasks up in the scene.
  /// @param model    with its surfaces
  /// @param devices  number of devices of the session: a task with a scope needs two
  /// Errors: those of resolve_task(), if the tasks have to fit; kInterrupted.
  static Result<std::unique_ptr<Training>> start(const TrainingOptions& options, const Model& model,
                                                 std::size_t devices, const Progress& progress);
  ~Training() { end(); }
  Training(const Training&) = delete;
  Training& operator=(const Training&) = delete;

  const std::vector<ViewedTask>& tasks() const { return viewed_; }
  /// Called before the first tick.
  void begin_session(const RecordingHeader& header);
  /// Processes a tick and the events that took effect with it. Does not throw.
  void observe(const TickRecord& tick, std::span<const RecordingEvent> events = {}) noexcept;
  /// Sets the viewer that moves the tip; empty: none. Call it before the first run of a session whose tip is
  /// moved by viewers: a run is then stored only if its learner alone moved the tip during it.
  void set_tip_holder(const std::optional<ViewerIdentity>& holder);
  /// Ends the run under way and waits until all finished runs are stored. Later ticks are ignored.
  void end();

  /// Begins a run.
  /// @param learner  pseudonym; empty: the learner of the session or of the lesson
  /// Errors: kBadInput for an unknown task; kUsage while a run is under way or the last one is being stored,
  /// if material was removed already and the task has a plan, and if a lesson requires another task.
  Result<void> begin(const std::string& task, const std::string& learner = "");
  /// Error kUsage if no run is under way.
  Result<void> end_run();
  /// Ends the run under way; if there is none, begins the task done last, or the first.
  Result<void> begin_or_end();

  /// Sets the learner of the following runs, and the only task that may be begun. Errors: kUsage while a run
  /// is under way and for an unknown task; those of check_learner.
  Result<void> teach(const LessonRequest& request);
  ViewedState::Lesson lesson() const;
  /// Learning curves, by TrainingOptions::curves.
  bool stores_runs() const { return static_cast<bool>(options_.curves); }
  Result<std::string> curves(const std::string& learner) const { return options_.curves(learner); }

  ViewedTraining state() const;
  std::shared_ptr<const ViewedDebriefing> debriefing() const;
  /// Finished and stored runs in chronological order, without the first `skipped`.
  std::vector<FinishedRun> finished(std::size_t skipped = 0) const;

 private:
  struct ActiveRun {
    std::size_t task;
    std::uint32_t number;
    TaskEvaluator evaluator;
    RunTrace trace;
    TickRange ticks{0, 0};
    std::uint64_t run_hash;
    std::string learner;
    bool was_driven = false, was_driven_by_others = false;  ///< Whether viewers held the tip during the run
  };

  Training(TrainingOptions options, std::vector<TaskInScene> in_scene, std::vector<ViewedTask> viewed);
  void finish_run(RunEnd end);
  ViewedTraining viewed(const ActiveRun& live) const;
  bool stores_runs_of(const std::string& learner) const { return options_.store_run && !learner.empty(); }
  void store_runs();
  static void note_tip_holder(const ViewerIdentity& holder, ActiveRun& live);
  std::optional<Error> reason_not_own(const ActiveRun& live) const;

  TrainingOptions options_;
  std::vector<TaskInScene> in_scene_;
  std::vector<ViewedTask> viewed_;

  mutable std::mutex mutex_;  // guards the members below, except store_thread_
  std::condition_variable changed_;
  std::shared_ptr<const RecordingHeader> header_;
  std::optional<RemovalFollower> removed_;  // removed volume; set if a task has a plan
  std::unique_ptr<ActiveRun> live_;
  struct PendingRun {
    std::unique_ptr<ActiveRun> live;
    TaskRun run;
  };
  std::deque<PendingRun> runs_to_store_;  // queue of runs to be stored
  bool storing_ = false, ending_ = false;
  std::uint32_t runs_ = 0;
  bool viewers_move_tip_ = false;
  std::optional<ViewerIdentity> tip_holder_;
  std::size_t last_task_ = 0;
  ViewedState::Lesson lesson_;
  ViewedTraining state_;  // state while no run is under way
  std::shared_ptr<const ViewedDebriefing> debriefing_;
  std::vector<FinishedRun> finished_;
  std::thread store_thread_;
};

}  // namespace palpate
