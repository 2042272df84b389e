#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "palpate/link/viewed_training.h"
#include "palpate/session/training.h"

namespace palpate {

/// The way of a tip and its force in a run: at most so many samples, evenly in time, each with the greatest
/// force since the one before.
class RunTrace {
 public:
  static constexpr std::size_t kMost = 1200;  ///< and the last one

  explicit RunTrace(std::size_t forces) : forces_(std::min(forces, ViewedDebriefing::kMostForces)) {}
  void see(const TaskEvaluator& run);
  /// The last sample is of the last tick.
  void finish(const TaskEvaluator& run);
  const std::vector<ViewedDebriefing::Sample>& samples() const { return samples_; }

 private:
  void thin_out();

  std::size_t forces_;
  double period_s_ = 0.02, next_s_ = 0;
  ViewedDebriefing::Sample coming_;
  std::vector<ViewedDebriefing::Sample> samples_;
};

/// A task as viewers are told of it. @param model  with its labels
ViewedTask viewed_task(const OfferedTask& offered, const TaskInScene& in_scene, const Model& model);
ViewedTaskEvent viewed_event(const TaskEvent& event);
/// The last of some events, and how many came before these.
void tell_events(std::span<const TaskEvent> events, std::uint64_t more, ViewedTraining& to);

/// How far a run is that is under way. @param name  OfferedTask::name
ViewedTraining viewed_run(const TaskEvaluator& run, const std::string& name, std::uint32_t number);
/// A run that is over.
ViewedDebriefing debriefed(const TaskEvaluator& run, const RunTrace& trace, const FinishedRun& finished);

}  // namespace palpate
