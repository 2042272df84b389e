#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "palpate/server/viewed_training.h"
#include "palpate/session/training.h"

namespace palpate {

/// Trajectory and forces of a run: a bounded number of samples, uniform in time, each with the maximum forces
/// since the previous sample.
class RunTrace {
 public:
  static constexpr std::size_t kMaxSamples = 1200;  ///< Maximum number of samples, not counting the last one

  explicit RunTrace(std::size_t forces) : forces_(std::min(forces, ViewedDebriefing::kMaxForces)) {}
  void observe(const TaskEvaluator& run);
  /// Adds the last tick as the last sample.
  void finish(const TaskEvaluator& run);
  const std::vector<ViewedDebriefing::Sample>& samples() const { return samples_; }

 private:
  void thin_out();

  std::size_t forces_;
  double period_s_ = 0.02, next_s_ = 0;
  ViewedDebriefing::Sample pending_sample_;
  std::vector<ViewedDebriefing::Sample> samples_;
};

/// Task as published to viewers.
/// @param model  with its labels
ViewedTask viewed_task(const OfferedTask& offered, const TaskInScene& in_scene, const Model& model);
ViewedTaskEvent viewed_event(const TaskEvent& event);
/// Publishes the most recent events and the number of earlier ones.
void report_events(std::span<const TaskEvent> events, std::uint64_t more, ViewedTraining& to);

/// Progress of a run that is under way.
/// @param name  OfferedTask::name
ViewedTraining viewed_run(const TaskEvaluator& run, const std::string& name, std::uint32_t number);
/// Debriefing of a finished run.
ViewedDebriefing debriefed(const TaskEvaluator& run, const RunTrace& trace, const FinishedRun& finished);

}  // namespace palpate
