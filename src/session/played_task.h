#pragma once

#include <memory>
#include <string>
#include <vector>

#include "palpate/link/viewed_training.h"
#include "palpate/session/playback.h"
#include "session/viewed_run.h"

namespace palpate {

/// A recording as a run of a task: how far it was at any of its places, and what came of it. It is looked
/// through once, as it is scored; how far it was is kept twenty times a second, and less often where that
/// would be more than 20 000 times.
class PlayedTask {
 public:
  /// @param model  as the recording begins with, with its surfaces
  PlayedTask(const PlayedTaskOptions& options, TaskInScene in_scene, const Model& model);

  /// Errors: those of TaskEvaluator::see().
  Result<void> see(const RecordingPart& part);
  /// All of the recording has been seen. @param is_whole  it was not cut short
  /// Errors: kBadInput where no tick was of the run.
  Result<void> finish(bool is_whole);

  const ViewedTask& task() const { return viewed_; }
  /// As it was at a place of the recording. @param time_s  TickRecord::time_s
  ViewedTraining at(double time_s) const;
  /// At a place after the run's end; null before.
  std::shared_ptr<const ViewedDebriefing> debriefing_at(double time_s) const {
    return time_s >= end_s_ ? debriefing_ : nullptr;
  }

 private:
  static constexpr std::size_t kMost = 20'000;
  void keep(double time_s);

  std::string name_;
  ViewedTask viewed_;
  RunReader reader_;
  RunTrace trace_;
  struct Kept {
    double at_s;  // of the recording
    ViewedTraining run;
  };
  std::vector<Kept> kept_;  // without events
  double period_s_ = 0.05, begin_s_ = 0, end_s_ = 0;
  TickRange ticks_{0, 0};
  TaskScore score_;
  std::shared_ptr<const ViewedDebriefing> debriefing_;
};

}  // namespace palpate
