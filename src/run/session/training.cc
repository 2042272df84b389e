#include "session/training.h"

#include <algorithm>
#include <cmath>
#include <exception>
#include <system_error>
#include <utility>

#include "palpate/base/learner.h"
#include "palpate/base/reason.h"

namespace palpate {
namespace {

Error usage_error(std::string what, std::string where, std::string remedy) {
  return {ErrorKind::kUsage, std::move(what), std::move(where), std::move(remedy)};
}

Error lacks_scope(const TaskFile& task) {
  return {ErrorKind::kUsage, "the task needs a second device for the scope, but the session has one device",
          task.where(task.scope->line), "add another --device: the second one holds the scope"};
}

}  // namespace

RunHistory history_of(const TaskFile& task, const std::vector<TaskRun>& runs) {
  RunHistory history;
  history.best.assign(task.metrics.size(), kNoValue);
  std::vector<bool> in_band;
  for (std::size_t n = 0; n < runs.size(); ++n) {
    // a run without ticks does not count and is not stored
    if (runs[n].score.ticks == 0) continue;
    in_band.push_back(runs[n].score.in_band);
    if (n + 1 == runs.size() || !runs[n].score.in_band) continue;
    for (const MetricValue& value : runs[n].score.metrics) {
      double& best = history.best[value.part];
      const bool more = info_of(value.metric).more_is_better;
      // a value that is not known is never better
      if (std::isnan(best) || (more ? value.value > best : value.value < best)) best = value.value;
    }
  }
  history.runs = static_cast<int>(in_band.size());
  history.in_a_row = runs_in_a_row(in_band);
  return history;
}

Training::Training(TrainingOptions options, std::vector<TaskInScene> in_scene, std::vector<ViewedTask> viewed)
    : options_(std::move(options)), in_scene_(std::move(in_scene)), viewed_(std::move(viewed)) {
  lesson_.learner = options_.learner;
  for (const TaskInScene& task : in_scene_)
    if (task.plan) removed_ = task.plan->untouched;
  store_thread_ = std::thread([this] { store_runs(); });
}

Result<std::unique_ptr<Training>> Training::start(const TrainingOptions& options, const Model& model,
                                                  std::size_t devices, const Progress& progress) try {
  TrainingOptions fitting = options;
  fitting.tasks.clear();
  std::vector<TaskInScene> in_scene;
  std::vector<ViewedTask> viewed;
  for (const OfferedTask& offered : options.tasks) {
    auto found = offered.file.scope && devices < 2 ? Result<TaskInScene>(lacks_scope(offered.file))
                                                   : resolve_task(offered.file, model, progress);
    if (!found && (options.requires_all_tasks || found.error().kind == ErrorKind::kInterrupted))
      return found.error();
    if (!found) continue;
    viewed.push_back(viewed_task(offered, *found, model));
    in_scene.push_back(*std::move(found));
    fitting.tasks.push_back(offered);
  }
  return std::unique_ptr<Training>(new Training(std::move(fitting), std::move(in_scene), std::move(viewed)));
} catch (const std::system_error& error) {
  return Error{ErrorKind::kUnavailable,
               std::string("cannot start the thread that stores runs of tasks: ") + error.what(), "",
               "close other programs, or raise the process limit (ulimit -u)"};
}

void Training::begin_session(const RecordingHeader& header) {
  {
    const std::lock_guard lock(mutex_);
    header_ = std::make_shared<const RecordingHeader>(header);
  }
  if (options_.begins_with_first_tick && !options_.tasks.empty()) (void)begin(options_.tasks.front().name);
}

// ---- a run

Result<void> Training::begin(const std::string& name, const std::string& learner) {
  const auto found = std::ranges::find(options_.tasks, name, &OfferedTask::name);
  if (found == options_.tasks.end())
    return Error{ErrorKind::kBadInput, "this session has no task with that name", "begin",
                 "choose a task of the scene's list"};
  const auto index = static_cast<std::size_t>(found - options_.tasks.begin());
  // allocate and copy the patches before locking, so that the recorder's thread does not wait for it
  auto live = std::make_unique<ActiveRun>(ActiveRun{index,
                                                    0,
                                                    TaskEvaluator(in_scene_[index]),
                                                    RunTrace(in_scene_[index].forces.size()),
                                                    {0, 0},
                                                    RecordingSummary{}.run_hash,
                                                    learner});
  const std::lock_guard lock(mutex_);
  if (ending_) return usage_error("the session is over", "", "");
  if (live_) return usage_error("a run is in progress", "begin", "end it first");
  if (storing_) return usage_error("the last run is still being stored", "begin", "try again in a moment");
  if (runs_ == kMaxRunsOfSession)
    return usage_error("this session has had " + std::to_string(runs_) + " runs", "begin",
                       "start a new session");
  if (!lesson_.task.empty() && name != lesson_.task)
    return usage_error("the teacher has chosen another task", "begin",
                       "start that one, or ask a teacher for this one");
  if (learner.empty()) live->learner = lesson_.learner;
  if (in_scene_[index].plan) {
    if (!removed_->removed().by_label_mm3().empty())
      return usage_error("tissue has already been removed", "begin",
                         "undo the strokes, or start a new session");
    live->evaluator.set_initial_removal(*removed_);
  }
  if (tip_holder_) note_tip_holder(*tip_holder_, *live);
  live->number = ++runs_;
  last_task_ = index;
  debriefing_ = nullptr;
  live_ = std::move(live);
  return {};
}

void Training::set_tip_holder(const std::optional<ViewerIdentity>& holder) {
  const std::lock_guard lock(mutex_);
  viewers_move_tip_ = true;
  tip_holder_ = holder;
  if (holder && live_) note_tip_holder(*holder, *live_);
}

// a viewer without a pseudonym that does not teach acts for the learner of the session
void Training::note_tip_holder(const ViewerIdentity& holder, ActiveRun& live) {
  const bool is_other = holder.teaches || (!holder.learner.empty() && holder.learner != live.learner);
  (is_other ? live.was_driven_by_others : live.was_driven) = true;
}

// Reason why a run is not its learner's own; empty: it is. With the mutex locked.
std::optional<Error> Training::reason_not_own(const ActiveRun& live) const {
  if (!viewers_move_tip_ || (live.was_driven && !live.was_driven_by_others)) return {};
  return usage_error(live.was_driven             ? "another viewer moved the tip during part of the run"
                     : live.was_driven_by_others ? "another viewer moved the tip during the run"
                                                 : "no viewer moved the tip during the run",
                     "", "a run is saved only if its learner alone moved the tip");
}

Result<void> Training::end_run() {
  const std::lock_guard lock(mutex_);
  if (!live_) return usage_error("no run is in progress", "end", "");
  finish_run(RunEnd::kRequested);
  return {};
}

Result<void> Training::begin_or_end() {
  std::string name;
  {
    const std::lock_guard lock(mutex_);
    if (live_) {
      finish_run(RunEnd::kRequested);
      return {};
    }
    if (options_.tasks.empty())
      return usage_error("there is no task to start", "", "start palpate explore with --task");
    name = lesson_.task.empty() ? options_.tasks[last_task_].name : lesson_.task;
  }
  return begin(name);
}

Result<void> Training::teach(const LessonRequest& request) {
  if (request.learner && !request.learner->empty())
    if (auto named = check_learner(*request.learner); !named) return named;
  const std::lock_guard lock(mutex_);
  if (live_ && (request.learner || request.task))
    return usage_error("a run is in progress", request.learner ? "learner" : "task", "end it first");
  if (request.task && !request.task->empty() &&
      std::ranges::find(options_.tasks, *request.task, &OfferedTask::name) == options_.tasks.end())
    return usage_error("this session has no task with that name", "task", "choose a task of this session");
  lesson_.learner = request.learner.value_or(lesson_.learner);
  lesson_.task = request.task.value_or(lesson_.task);
  return {};
}

ViewedState::Lesson Training::lesson() const {
  const std::lock_guard lock(mutex_);
  return lesson_;
}

void Training::observe(const TickRecord& tick, std::span<const RecordingEvent> events) noexcept {
  const std::lock_guard lock(mutex_);
  try {
    for (const RecordingEvent& event : removed_ ? events : std::span<const RecordingEvent>()) {
      removed_->on_event(event);
      if (live_) live_->evaluator.on_event(event);
    }
    if (!live_) return;
    ActiveRun& live = *live_;
    if (live.evaluator.ticks() == 0) live.ticks.first = tick.tick;
    if (!live.evaluator.observe(tick)) return finish_run(RunEnd::kFailure);
    live.ticks.last = tick.tick;
    live.run_hash = mix_run_hash(live.run_hash, tick.state_hash);
    live.trace.observe(live.evaluator);
    if (live.evaluator.ended()) finish_run(RunEnd::kTask);
  } catch (const std::exception&) {
    // Out of memory: the run ends with kFailure, or is dropped if even that fails.
    try {
      if (live_) finish_run(RunEnd::kFailure);
    } catch (const std::exception&) {
      live_ = nullptr;
    }
  }
}

// with the mutex locked
void Training::finish_run(RunEnd end) {
  live_->trace.finish(live_->evaluator);
  PendingRun pending{nullptr, {}};
  TaskRun& run = pending.run;
  run.task = options_.tasks[live_->task].name;
  run.number = live_->number;
  run.end = end;
  run.learner = live_->learner;
  run.score = live_->evaluator.score(false);
  if (end == RunEnd::kFailure) run.score.in_band = false;
  run.ticks = live_->ticks;
  run.run_hash = live_->run_hash;
  run.header = header_;
  ViewedTraining state = viewed(*live_);
  state.phase = ViewedTraining::Phase::kStoring;
  // the run is over: no force belongs to it any more
  std::ranges::fill(state.forces_N, 0);
  std::ranges::fill(state.protected_N, 0);
  state.touch_N = 0;
  state.unseen = false;
  runs_to_store_.push_back(std::move(pending));
  runs_to_store_.back().live = std::move(live_);
  state_ = std::move(state);
  storing_ = true;
  changed_.notify_all();
}

void Training::store_runs() {
  std::unique_lock lock(mutex_);
  while (true) {
    changed_.wait(lock, [this] { return ending_ || !runs_to_store_.empty(); });
    if (runs_to_store_.empty()) return;
    PendingRun pending = std::move(runs_to_store_.front());
    runs_to_store_.pop_front();
    const TaskFile& task = options_.tasks[pending.live->task].file;
    std::vector<TaskRun> runs;
    for (const FinishedRun& earlier : finished_)
      if (earlier.run.task == pending.run.task && earlier.run.learner == pending.run.learner)
        runs.push_back(earlier.run);
    std::optional<Error> refused = reason_not_own(*pending.live);
    lock.unlock();
    FinishedRun finished{pending.run, {}};
    std::shared_ptr<const ViewedDebriefing> debriefing;
    try {
      runs.push_back(pending.run);
      finished.history = history_of(task, runs);
      // a run without ticks does not count
      if (!stores_runs_of(pending.run.learner) || pending.run.score.ticks == 0) {
        // nothing to store
      } else if (refused) {
        finished.history.not_stored = std::move(refused);
      } else {
        const RunHistory history = options_.store_run(task, pending.run);
        if (history.runs > 0) finished.history = history;
        finished.history.run_id = history.run_id;
        finished.history.not_stored = history.not_stored;
      }
    } catch (const std::exception& why) {
      finished.history.not_stored = Error{
          ErrorKind::kUnavailable, std::string("the run could not be stored: ") + reason_of(why), "", ""};
    }
    try {
      finished.history.best.resize(task.metrics.size(), kNoValue);
      debriefing = std::make_shared<const ViewedDebriefing>(
          debriefed(pending.live->evaluator, pending.live->trace, finished));
      std::vector<TaskEvent>& events = finished.run.score.events;
      if (events.size() > ViewedDebriefing::kMaxEvents) {
        finished.run.score.more_events += events.size() - ViewedDebriefing::kMaxEvents;
        events.resize(ViewedDebriefing::kMaxEvents);
      }
    } catch (const std::exception&) {
      // out of memory: the run has no debriefing
    }
    lock.lock();
    finished_.push_back(std::move(finished));
    debriefing_ = std::move(debriefing);
    storing_ = !runs_to_store_.empty();
    if (!storing_) state_.phase = ViewedTraining::Phase::kOver;
    changed_.notify_all();
  }
}

void Training::end() {
  {
    const std::lock_guard lock(mutex_);
    if (live_) finish_run(RunEnd::kSession);
    ending_ = true;
  }
  changed_.notify_all();
  if (store_thread_.joinable()) store_thread_.join();
}

// ---- state published to viewers

// with the mutex locked
ViewedTraining Training::viewed(const ActiveRun& live) const {
  ViewedTraining state = viewed_run(live.evaluator, options_.tasks[live.task].name, live.number);
  state.is_stored = stores_runs_of(live.learner);
  state.learner = live.learner;
  return state;
}

ViewedTraining Training::state() const {
  const std::lock_guard lock(mutex_);
  if (live_) return viewed(*live_);
  ViewedTraining state = state_;
  if (state.phase != ViewedTraining::Phase::kStoring) state.is_stored = stores_runs_of(lesson_.learner);
  return state;
}

std::shared_ptr<const ViewedDebriefing> Training::debriefing() const {
  const std::lock_guard lock(mutex_);
  return debriefing_;
}

std::vector<FinishedRun> Training::finished(std::size_t skipped) const {
  const std::lock_guard lock(mutex_);
  return {finished_.begin() + static_cast<std::ptrdiff_t>(std::min(skipped, finished_.size())),
          finished_.end()};
}

}  // namespace palpate
