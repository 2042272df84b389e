#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/server/viewed_training.h"
#include "palpate/session/playback.h"
#include "session/viewed_run.h"

namespace palpate {

/// Recording as a run of a task: progress at any position, and the result. The recording is processed once,
/// by the same evaluator that scores it; progress is stored twenty times per second, and less often if that
/// would exceed 20 000 samples.
class PlayedTask {
 public:
  /// @param model  at the beginning of the recording, with its surfaces
  PlayedTask(const PlayedTaskOptions& options, TaskInScene in_scene, const Model& model);

  /// Errors: those of TaskEvaluator::observe().
  Result<void> observe(const RecordingPart& part);
  /// Called after the whole recording was passed to observe().
  /// @param is_whole  whether the recording is complete
  /// Errors: kBadInput if no tick belongs to the run.
  Result<void> finish(bool is_whole);

  const ViewedTask& task() const { return viewed_; }
  /// Progress at a position.
  /// @param time_s  TickRecord::time_s
  ViewedTraining at(double time_s) const;
  /// Debriefing at a position after the run's end; null before.
  std::shared_ptr<const ViewedDebriefing> debriefing_at(double time_s) const {
    return time_s >= end_s_ ? debriefing_ : nullptr;
  }

 private:
  static constexpr std::size_t kMaxMoments = 20'000;
  void store_moment(double time_s);

  std::string name_;
  ViewedTask viewed_;
  RunReader reader_;
  RunTrace trace_;
  struct StoredProgress {
    double at_s;  // time in the recording
    ViewedTraining run;
  };
  std::vector<StoredProgress> stored_;  // without events
  double period_s_ = 0.05, begin_s_ = 0, end_s_ = 0;
  TickRange ticks_{0, 0};
  TaskScore score_;
  std::shared_ptr<const ViewedDebriefing> debriefing_;
};

}  // namespace palpate
