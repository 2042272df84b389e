#include "session/viewed_run.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate {
namespace {

std::array<double, 3> numbers_of(const Eigen::Vector3d& v) {
  return {v.x(), v.y(), v.z()};
}

std::vector<LabelId> labels_in(const std::vector<bool>& has) {
  std::vector<LabelId> labels;
  for (std::size_t n = 0; n < has.size(); ++n)
    if (has[n]) labels.push_back(static_cast<LabelId>(n));
  return labels;
}

const char* kind_text(StepKind kind) {
  switch (kind) {
    case StepKind::kTouch:
      return "touch";
    case StepKind::kVisit:
      return "visit";
    case StepKind::kCover:
      return "cover";
    case StepKind::kRemove:
      return "remove";
  }
  return "";
}

const char* end_text(RunEnd end) {
  switch (end) {
    case RunEnd::kTask:
      return "task";
    case RunEnd::kRequested:
      return "asked";
    case RunEnd::kSession:
      return "session";
    case RunEnd::kFailure:
      return "trouble";
  }
  return "";
}

template <class Triple>
std::optional<std::array<double, 3>> numbers_of(const std::optional<Triple>& v) {
  return v ? std::optional(numbers_of(v->eigen())) : std::nullopt;
}

ViewedTask::Region::Extent extent_of(const TaskRegion& region, const RegionInScene& in_scene) {
  ViewedTask::Region::Extent extent;
  extent.labels = labels_in(in_scene.has_label);
  extent.centre_mm = numbers_of(region.point);
  extent.landmark = numbers_of(region.landmark);
  extent.half = numbers_of(region.half);
  extent.radius_mm = region.radius_mm.value_or(0);
  if (region.plane_point)
    extent.planes.push_back(
        {numbers_of(region.plane_point->eigen()), numbers_of(region.plane_normal->eigen())});
  return extent;
}

}  // namespace

ViewedTaskEvent viewed_event(const TaskEvent& event) {
  return {kind_name(event.kind), event.part, event.time_s, event.force_N};
}

ViewedTask viewed_task(const OfferedTask& offered, const TaskInScene& in_scene, const Model& model) {
  const TaskFile& file = offered.file;
  ViewedTask task;
  task.name = offered.name;
  task.title = file.title;
  task.briefing = file.briefing;
  task.quiz = file.quiz;
  task.ordered = file.ordered;
  task.ends_with_steps = file.end == TaskEnd::kSteps;
  task.time_limit_s = file.time_limit_s;
  task.in_a_row = file.in_a_row;
  const auto add_region = [&](const std::string& name, const RegionView& view) {
    task.regions.push_back({name, numbers_of(view.centre_mm), view.radius_mm, numbers_of(view.outward)});
  };
  for (std::size_t n = 0; n < file.regions.size(); ++n) {
    add_region(file.regions[n].name, view_of(in_scene.regions[n], model));
    task.regions.back().extent = extent_of(file.regions[n], in_scene.regions[n]);
  }
  // the regions of the plan follow those of the task
  for (std::size_t n = 0; file.plan && n < file.plan->regions.size(); ++n)
    add_region(file.plan->regions[n].name, view_of(in_scene.plan->plan.regions[n], model));
  for (const TaskStep& step : file.steps) {
    const std::size_t region =
        step.kind == StepKind::kRemove ? file.regions.size() + step.region : step.region;
    task.steps.push_back(
        {step.name, kind_text(step.kind), region, step.force_N, step.seconds, step.coverage, step.seen});
  }
  if (file.scope) task.scope = {file.scope->optics.lean_deg, file.scope->optics.back_mm};
  for (std::size_t n = 0; n < file.forces.size(); ++n)
    task.forces.push_back({labels_in(in_scene.forces[n]), file.forces[n].band_N, file.forces[n].limit_N});
  for (std::size_t n = 0; n < file.protections.size(); ++n)
    task.protections.push_back({labels_in(in_scene.protections[n]), file.protections[n].limit_N});
  for (std::size_t n = 0; n < file.metrics.size(); ++n) {
    const TaskMetric& metric = file.metrics[n];
    const MetricInfo& info = info_of(metric.metric);
    task.metrics.push_back({std::string(info.name), std::string(info.unit), labels_in(in_scene.metrics[n]),
                            info.more_is_better, metric.at_least, metric.at_most, metric.basis});
  }
  if (file.answer) {
    task.answer_s = file.answer->seconds;
    task.to_find = labels_in(in_scene.answer_labels);
  }
  return task;
}

void RunTrace::observe(const TaskEvaluator& run) {
  pending_sample_.touch_N = std::max(pending_sample_.touch_N, run.touch_N());
  for (std::size_t n = 0; n < forces_; ++n)
    pending_sample_.forces_N[n] = std::max(pending_sample_.forces_N[n], run.force_N(n));
  const double now_s = run.time_s();
  if (now_s < next_s_) return;
  pending_sample_.time_s = now_s;
  if (const auto tip = run.tip_mm()) pending_sample_.tip_mm = numbers_of(*tip);
  samples_.push_back(std::exchange(pending_sample_, {}));
  next_s_ = now_s + period_s_;
  if (samples_.size() == kMaxSamples) thin_out();
}

void RunTrace::finish(const TaskEvaluator& run) {
  if (run.ticks() == 0 || (!samples_.empty() && samples_.back().time_s >= run.time_s())) return;
  pending_sample_.time_s = run.time_s();
  if (const auto tip = run.tip_mm()) pending_sample_.tip_mm = numbers_of(*tip);
  samples_.push_back(std::exchange(pending_sample_, {}));
}

// halves the number of samples and doubles the period; a merged sample takes the later position and the
// larger forces
void RunTrace::thin_out() {
  std::vector<ViewedDebriefing::Sample> thinned;
  thinned.reserve(kMaxSamples);
  thinned.push_back(samples_.front());
  for (std::size_t n = 2; n < samples_.size(); n += 2) {
    const ViewedDebriefing::Sample& before = samples_[n - 1];
    ViewedDebriefing::Sample sample = samples_[n];
    sample.touch_N = std::max(sample.touch_N, before.touch_N);
    for (std::size_t f = 0; f < forces_; ++f)
      sample.forces_N[f] = std::max(sample.forces_N[f], before.forces_N[f]);
    thinned.push_back(sample);
  }
  // an unpaired last sample is merged into the sample being accumulated
  if (samples_.size() % 2 == 0) {
    pending_sample_.touch_N = std::max(pending_sample_.touch_N, samples_.back().touch_N);
    for (std::size_t f = 0; f < forces_; ++f)
      pending_sample_.forces_N[f] = std::max(pending_sample_.forces_N[f], samples_.back().forces_N[f]);
  }
  samples_ = std::move(thinned);
  period_s_ *= 2;
  next_s_ = samples_.back().time_s + period_s_;
}

void report_events(std::span<const TaskEvent> events, std::uint64_t more, ViewedTraining& to) {
  const auto last = events.last(std::min(events.size(), ViewedTraining::kMaxEvents));
  to.events.clear();
  for (const TaskEvent& event : last) to.events.push_back(viewed_event(event));
  to.events_before = events.size() - last.size() + more;
}

ViewedTraining viewed_run(const TaskEvaluator& run, const std::string& name, std::uint32_t number) {
  const TaskFile& task = run.task().file;
  ViewedTraining state;
  state.phase = ViewedTraining::Phase::kRunning;
  state.run = number;
  state.task = name;
  state.time_s = run.time_s();
  state.done = run.done();
  for (std::size_t n = 0; n < state.done.size(); ++n) state.fraction.push_back(run.fraction_of_step(n));
  for (std::size_t n = 0; n < task.forces.size(); ++n) state.forces_N.push_back(run.force_N(n));
  for (std::size_t n = 0; n < task.protections.size(); ++n) state.protected_N.push_back(run.protected_N(n));
  state.touch_N = run.touch_N();
  state.unseen = run.touches_invisible();
  state.missing_s = run.missing_s();
  report_events(run.events(), run.more_events(), state);
  return state;
}

ViewedDebriefing debriefed(const TaskEvaluator& evaluator, const RunTrace& trace,
                           const FinishedRun& finished) {
  const TaskRun& run = finished.run;
  const TaskScore& score = run.score;
  ViewedDebriefing debriefing;
  debriefing.run = run.number;
  debriefing.learner = run.learner;
  debriefing.task = run.task;
  debriefing.end = end_text(run.end);
  debriefing.in_band = score.in_band;
  debriefing.time_s = score.time_s;
  debriefing.missing_s = score.missing_s;
  debriefing.ticks = score.ticks;
  debriefing.first_tick = run.ticks.first;
  debriefing.last_tick = run.ticks.last;
  for (const MetricValue& value : score.metrics)
    debriefing.metrics.push_back({value.value, finished.history.best[value.part], value.in_band});
  debriefing.done = score.done;
  const std::size_t events = std::min(score.events.size(), ViewedDebriefing::kMaxEvents);
  for (std::size_t n = 0; n < events; ++n) debriefing.events.push_back(viewed_event(score.events[n]));
  debriefing.more_events = score.events.size() - events + score.more_events;
  debriefing.forces = std::min(evaluator.task().file.forces.size(), ViewedDebriefing::kMaxForces);
  debriefing.samples = trace.samples();

  // subsample the patches if there are too many
  std::vector<SurfacePatches::Patch> patches;
  for (const RegionInScene& region : evaluator.task().regions)
    for (const SurfacePatches::Patch& patch : region.patches.all()) patches.push_back(patch);
  const std::size_t step =
      (patches.size() + ViewedDebriefing::kMaxPatches - 1) / ViewedDebriefing::kMaxPatches;
  for (std::size_t n = 0; n < patches.size(); n += step)
    debriefing.patches.push_back({numbers_of(patches[n].centre_mm), patches[n].covered});
  debriefing.omitted_patches = patches.size() - debriefing.patches.size();

  if (const auto answer = evaluator.answer()) debriefing.answer_mm = numbers_of(answer->position_mm);
  if (const auto& middle = evaluator.task().answer_mm) debriefing.to_find_mm = numbers_of(*middle);
  debriefing.runs = finished.history.runs;
  debriefing.in_a_row = finished.history.in_a_row;
  debriefing.run_id = finished.history.run_id;
  debriefing.not_stored = finished.history.not_stored;
  return debriefing;
}

}  // namespace palpate
