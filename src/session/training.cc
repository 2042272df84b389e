#include "session/training.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <system_error>
#include <utility>

namespace palpate {
namespace {

Error cannot_train(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

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
  }
  return "";
}

const char* end_text(RunEnd end) {
  switch (end) {
    case RunEnd::kTask:
      return "task";
    case RunEnd::kAsked:
      return "asked";
    case RunEnd::kSession:
      return "session";
    case RunEnd::kTrouble:
      return "trouble";
  }
  return "";
}

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
  for (std::size_t n = 0; n < file.regions.size(); ++n) {
    const RegionView view = view_of(in_scene.regions[n], model);
    task.regions.push_back(
        {file.regions[n].name, numbers_of(view.middle_mm), view.radius_mm, numbers_of(view.outward)});
  }
  for (const TaskStep& step : file.steps)
    task.steps.push_back(
        {step.name, kind_text(step.kind), step.region, step.force_N, step.seconds, step.coverage});
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

}  // namespace

RunHistory history_of(const TaskFile& task, const std::vector<TaskRun>& runs) {
  RunHistory history;
  history.best.assign(task.metrics.size(), kNotKnown);
  std::vector<bool> in_band;
  for (std::size_t n = 0; n < runs.size(); ++n) {
    // one without a tick is none, and is kept nowhere
    if (runs[n].score.ticks == 0) continue;
    in_band.push_back(runs[n].score.in_band);
    if (n + 1 == runs.size() || !runs[n].score.in_band) continue;
    for (const MetricValue& value : runs[n].score.metrics) {
      double& best = history.best[value.part];
      const bool more = info_of(value.metric).more_is_better;
      // what is not known is never better
      if (std::isnan(best) || (more ? value.value > best : value.value < best)) best = value.value;
    }
  }
  history.runs = static_cast<int>(in_band.size());
  history.in_a_row = runs_in_a_row(in_band);
  return history;
}

void RunTrace::see(const TaskEvaluator& run) {
  coming_.touch_N = std::max(coming_.touch_N, run.touch_N());
  for (std::size_t n = 0; n < forces_; ++n)
    coming_.forces_N[n] = std::max(coming_.forces_N[n], run.force_N(n));
  const double now_s = run.time_s();
  if (now_s < next_s_) return;
  coming_.time_s = now_s;
  if (const auto tip = run.tip_mm()) coming_.tip_mm = numbers_of(*tip);
  samples_.push_back(std::exchange(coming_, {}));
  next_s_ = now_s + period_s_;
  if (samples_.size() == kMost) thin_out();
}

void RunTrace::finish(const TaskEvaluator& run) {
  if (run.ticks() == 0 || (!samples_.empty() && samples_.back().time_s >= run.time_s())) return;
  coming_.time_s = run.time_s();
  if (const auto tip = run.tip_mm()) coming_.tip_mm = numbers_of(*tip);
  samples_.push_back(std::exchange(coming_, {}));
}

// half as many, each for twice the time: of two samples the later place and the greater force
void RunTrace::thin_out() {
  std::vector<ViewedDebriefing::Sample> kept;
  kept.reserve(kMost);
  kept.push_back(samples_.front());
  for (std::size_t n = 2; n < samples_.size(); n += 2) {
    const ViewedDebriefing::Sample& before = samples_[n - 1];
    ViewedDebriefing::Sample sample = samples_[n];
    sample.touch_N = std::max(sample.touch_N, before.touch_N);
    for (std::size_t f = 0; f < forces_; ++f)
      sample.forces_N[f] = std::max(sample.forces_N[f], before.forces_N[f]);
    kept.push_back(sample);
  }
  // one that is left over goes on
  if (samples_.size() % 2 == 0) {
    coming_.touch_N = std::max(coming_.touch_N, samples_.back().touch_N);
    for (std::size_t f = 0; f < forces_; ++f)
      coming_.forces_N[f] = std::max(coming_.forces_N[f], samples_.back().forces_N[f]);
  }
  samples_ = std::move(kept);
  period_s_ *= 2;
  next_s_ = samples_.back().time_s + period_s_;
}

Training::Training(TrainingOptions options, std::vector<TaskInScene> in_scene, std::vector<ViewedTask> viewed)
    : options_(std::move(options)), in_scene_(std::move(in_scene)), viewed_(std::move(viewed)) {
  state_.keeps = options_.keeps;
  keeper_ = std::thread([this] { keep(); });
}

Result<std::unique_ptr<Training>> Training::start(const TrainingOptions& options, const Model& model,
                                                  const Progress& progress) try {
  TrainingOptions fitting = options;
  fitting.tasks.clear();
  std::vector<TaskInScene> in_scene;
  std::vector<ViewedTask> viewed;
  for (const OfferedTask& offered : options.tasks) {
    auto found = look_up(offered.file, model, progress);
    if (!found && (options.have_to_fit || found.error().kind == ErrorKind::kInterrupted))
      return found.error();
    if (!found) continue;
    viewed.push_back(viewed_task(offered, *found, model));
    in_scene.push_back(*std::move(found));
    fitting.tasks.push_back(offered);
  }
  return std::unique_ptr<Training>(new Training(std::move(fitting), std::move(in_scene), std::move(viewed)));
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable, std::string("no thread to keep runs of tasks: ") + error.what(), "",
               "close other programs, or raise the limit of processes (ulimit -u)"};
}

void Training::begin_session(const RecordingHeader& header) {
  {
    const std::lock_guard lock(mutex_);
    header_ = std::make_shared<const RecordingHeader>(header);
  }
  if (options_.begins_at_once && !options_.tasks.empty()) (void)begin(options_.tasks.front().name);
}

// ---- a run

Result<void> Training::begin(const std::string& name) {
  const auto found = std::ranges::find(options_.tasks, name, &OfferedTask::name);
  if (found == options_.tasks.end())
    return Error{ErrorKind::kBadInput, "this session has no task of that name", "begin",
                 "the scene lists those that can be begun"};
  const auto place = static_cast<std::size_t>(found - options_.tasks.begin());
  // what there is of patches is copied before the recorder could wait for it
  auto live = std::make_unique<Live>(Live{place,
                                          0,
                                          TaskEvaluator(in_scene_[place]),
                                          RunTrace(in_scene_[place].forces.size()),
                                          {0, 0},
                                          RecordingSummary{}.run_hash});
  const std::lock_guard lock(mutex_);
  if (ending_) return cannot_train("the session is over", "", "");
  if (live_) return cannot_train("a run is under way", "begin", "end it first");
  if (keeping_) return cannot_train("the last run is still being kept", "begin", "ask again in a moment");
  if (runs_ == kMostRunsOfSession)
    return cannot_train("this session has had " + std::to_string(runs_) + " runs", "begin",
                        "start another one");
  live->number = ++runs_;
  last_task_ = place;
  debriefing_ = nullptr;
  live_ = std::move(live);
  return {};
}

Result<void> Training::end_run() {
  const std::lock_guard lock(mutex_);
  if (!live_) return cannot_train("no run is under way", "end", "");
  over(RunEnd::kAsked);
  return {};
}

Result<void> Training::begin_or_end() {
  std::string name;
  {
    const std::lock_guard lock(mutex_);
    if (live_) {
      over(RunEnd::kAsked);
      return {};
    }
    if (options_.tasks.empty())
      return cannot_train("there is no task to be begun", "", "start palpate explore with --task");
    name = options_.tasks[last_task_].name;
  }
  return begin(name);
}

void Training::see(const TickRecord& tick) noexcept {
  const std::lock_guard lock(mutex_);
  if (!live_) return;
  try {
    Live& live = *live_;
    if (live.evaluator.ticks() == 0) live.ticks.first = tick.tick;
    if (!live.evaluator.see(tick)) return over(RunEnd::kTrouble);
    live.ticks.last = tick.tick;
    live.run_hash = mix_run_hash(live.run_hash, tick.state_hash);
    live.trace.see(live.evaluator);
    if (live.evaluator.ended()) over(RunEnd::kTask);
  } catch (const std::exception&) {
    // no memory for it: it is told, or not even that
    try {
      if (live_) over(RunEnd::kTrouble);
    } catch (const std::exception&) {
      live_ = nullptr;
    }
  }
}

// with the lock
void Training::over(RunEnd end) {
  live_->trace.finish(live_->evaluator);
  Over over{nullptr, {}};
  TaskRun& run = over.run;
  run.task = options_.tasks[live_->task].name;
  run.number = live_->number;
  run.end = end;
  run.score = live_->evaluator.score(false);
  if (end == RunEnd::kTrouble) run.score.in_band = false;
  run.ticks = live_->ticks;
  run.run_hash = live_->run_hash;
  run.header = header_;
  ViewedTraining state = seen(*live_);
  state.phase = ViewedTraining::Phase::kKeeping;
  // nothing presses any more that would be of it
  std::ranges::fill(state.forces_N, 0);
  std::ranges::fill(state.protected_N, 0);
  state.touch_N = 0;
  over_.push_back(std::move(over));
  over_.back().live = std::move(live_);
  state_ = std::move(state);
  keeping_ = true;
  changed_.notify_all();
}

void Training::keep() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ending_ || !over_.empty(); });
    if (over_.empty()) return;
    Over over = std::move(over_.front());
    over_.pop_front();
    const TaskFile& task = options_.tasks[over.live->task].file;
    std::vector<TaskRun> runs;
    for (const FinishedRun& earlier : finished_)
      if (earlier.run.task == over.run.task) runs.push_back(earlier.run);
    lock.unlock();
    FinishedRun finished{over.run, {}};
    std::shared_ptr<const ViewedDebriefing> told;
    try {
      runs.push_back(over.run);
      finished.history = history_of(task, runs);
      // one without a tick is none
      if (options_.over && over.run.score.ticks > 0) {
        const RunHistory history = options_.over(task, over.run);
        if (history.runs > 0) finished.history = history;
        finished.history.kept = history.kept;
        finished.history.not_kept = history.not_kept;
      }
    } catch (const std::exception& why) {
      finished.history.not_kept =
          Error{ErrorKind::kUnavailable, std::string("the run could not be kept: ") + why.what(), "", ""};
    }
    try {
      finished.history.best.resize(task.metrics.size(), kNotKnown);
      told = std::make_shared<const ViewedDebriefing>(debrief(*over.live, finished));
      std::vector<TaskEvent>& events = finished.run.score.events;
      if (events.size() > ViewedDebriefing::kMostEvents) {
        finished.run.score.more_events += events.size() - ViewedDebriefing::kMostEvents;
        events.resize(ViewedDebriefing::kMostEvents);
      }
    } catch (const std::exception&) {
      // no memory for what would be shown of it
    }
    lock.lock();
    finished_.push_back(std::move(finished));
    debriefing_ = std::move(told);
    keeping_ = !over_.empty();
    if (!keeping_) state_.phase = ViewedTraining::Phase::kOver;
    changed_.notify_all();
  }
}

void Training::end() {
  {
    const std::lock_guard lock(mutex_);
    if (live_) over(RunEnd::kSession);
    ending_ = true;
  }
  changed_.notify_all();
  if (keeper_.joinable()) keeper_.join();
}

// ---- what is told

ViewedTraining Training::state() const {
  const std::lock_guard lock(mutex_);
  return live_ ? seen(*live_) : state_;
}

// with the lock
ViewedTraining Training::seen(const Live& live) const {
  const TaskEvaluator& run = live.evaluator;
  ViewedTraining state;
  state.phase = ViewedTraining::Phase::kRunning;
  state.run = live.number;
  state.task = options_.tasks[live.task].name;
  state.time_s = run.time_s();
  state.done = run.done();
  for (std::size_t n = 0; n < state.done.size(); ++n) state.share.push_back(run.share_of_step(n));
  const ViewedTask& task = viewed_[live.task];
  for (std::size_t n = 0; n < task.forces.size(); ++n) state.forces_N.push_back(run.force_N(n));
  for (std::size_t n = 0; n < task.protections.size(); ++n) state.protected_N.push_back(run.protected_N(n));
  state.touch_N = run.touch_N();
  state.missing_s = run.missing_s();
  const auto& events = run.events();
  for (std::size_t n = events.size() - std::min(events.size(), ViewedTraining::kMostEvents);
       n < events.size(); ++n)
    state.events.push_back(viewed_event(events[n]));
  state.events_before = events.size() - state.events.size() + run.more_events();
  state.keeps = options_.keeps;
  return state;
}

std::shared_ptr<const ViewedDebriefing> Training::debriefing() const {
  const std::lock_guard lock(mutex_);
  return debriefing_;
}

std::vector<FinishedRun> Training::finished(std::size_t but) const {
  const std::lock_guard lock(mutex_);
  return {finished_.begin() + static_cast<std::ptrdiff_t>(std::min(but, finished_.size())), finished_.end()};
}

ViewedDebriefing Training::debrief(const Live& live, const FinishedRun& finished) const {
  const TaskRun& run = finished.run;
  const TaskScore& score = run.score;
  ViewedDebriefing told;
  told.run = run.number;
  told.task = run.task;
  told.end = end_text(run.end);
  told.in_band = score.in_band;
  told.time_s = score.time_s;
  told.missing_s = score.missing_s;
  told.ticks = score.ticks;
  told.first_tick = run.ticks.first;
  told.last_tick = run.ticks.last;
  for (const MetricValue& value : score.metrics)
    told.metrics.push_back({value.value, finished.history.best[value.part], value.in_band});
  told.done = score.done;
  const std::size_t events = std::min(score.events.size(), ViewedDebriefing::kMostEvents);
  for (std::size_t n = 0; n < events; ++n) told.events.push_back(viewed_event(score.events[n]));
  told.more_events = score.events.size() - events + score.more_events;
  told.forces = std::min(viewed_[live.task].forces.size(), ViewedDebriefing::kMostForces);
  told.samples = live.trace.samples();

  // of many patches every so many-th
  std::vector<SurfacePatches::Patch> patches;
  for (const RegionInScene& region : live.evaluator.task().regions)
    for (const SurfacePatches::Patch& patch : region.patches.all()) patches.push_back(patch);
  const std::size_t step =
      (patches.size() + ViewedDebriefing::kMostPatches - 1) / ViewedDebriefing::kMostPatches;
  for (std::size_t n = 0; n < patches.size(); n += step)
    told.patches.push_back({numbers_of(patches[n].middle_mm), patches[n].covered});
  told.patches_left_out = patches.size() - told.patches.size();

  if (const auto answer = live.evaluator.answer()) told.answer_mm = numbers_of(answer->place_mm);
  if (const auto& middle = live.evaluator.task().answer_mm) told.to_find_mm = numbers_of(*middle);
  told.runs = finished.history.runs;
  told.in_a_row = finished.history.in_a_row;
  told.kept = finished.history.kept;
  told.not_kept = finished.history.not_kept;
  return told;
}

}  // namespace palpate
