#include "server/redacted_steps.h"

#include <algorithm>
#include <string_view>

#include "server/viewed_vectors.h"

namespace palpate::server {

void RedactedSteps::follow(const ViewedTraining& training) {
  is_running_ = training.phase == ViewedTraining::Phase::kRunning;
  if (training.run == run_) return;
  run_ = training.run;
  steps_.clear();
  const auto task = std::ranges::find(scene_.tasks, training.task, &ViewedTask::name);
  if (task == scene_.tasks.end()) return;
  ordered_ = task->ordered;
  for (const ViewedTask::Step& requested : task->steps) {
    steps_.push_back({requested, {}});
    const ViewedTask::Region& region = task->regions[requested.region];
    if (region.extent) steps_.back().region.emplace(*scene_.labels, *region.extent);
  }
}

bool RedactedSteps::is_met(const Step& step, const TickRecord& tick) const {
  if (!step.region || step.requested.in_scope_view) return false;
  const std::string_view kind = step.requested.kind;
  if (kind == "visit") return step.region->contains_point(vector_of(tick.device[0].tip_patient_mm));
  if (kind != "touch") return false;
  double force_N = 0;
  const auto devices = static_cast<std::size_t>(std::clamp(tick.devices, 1, kMaxDevices));
  for (std::size_t d = 0; d < devices; ++d) {
    const DeviceTick& device = tick.device[d];
    if (device.label == 0 || !step.region->has(device.label) ||
        !step.region->contains_point(vector_of(device.proxy_patient_mm)))
      continue;
    force_N += vector_of(device.force_N).norm();
  }
  const bool is_below = step.requested.force_N[1] < force_N;
  return force_N > 0 && force_N >= step.requested.force_N[0] && !is_below;
}

void RedactedSteps::observe(const TickRecord& tick) {
  // a gap between samples counts at most as long as the slowest viewer's pose period
  constexpr double kMaxBetween_s = 0.1;
  const double dt_s = std::clamp(tick.time_s - last_s_, 0.0, kMaxBetween_s);
  last_s_ = tick.time_s;
  if (!is_running_) return;
  for (std::size_t n = 0; n < steps_.size(); ++n) {
    Step& step = steps_[n];
    if (step.done || (ordered_ && n > 0 && !steps_[n - 1].done)) continue;
    const bool met = is_met(step, tick);
    step.met_s = met && step.was_met ? step.met_s + dt_s : 0;
    step.was_met = met;
    step.done = met && step.met_s >= step.requested.seconds;
  }
}

std::vector<bool> RedactedSteps::done() const {
  std::vector<bool> done;
  for (const Step& step : steps_) done.push_back(step.done);
  return done;
}

std::vector<double> RedactedSteps::fraction() const {
  std::vector<double> fraction;
  for (const Step& step : steps_)
    fraction.push_back(step.done                    ? 1
                       : step.requested.seconds > 0 ? std::min(1.0, step.met_s / step.requested.seconds)
                                                    : 0);
  return fraction;
}

}  // namespace palpate::server
