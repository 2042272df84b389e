#include "session/played_task.h"

#include <algorithm>
#include <iterator>
#include <utility>

namespace palpate {
namespace {

constexpr std::uint32_t kOnlyRun = 1;

}  // namespace

PlayedTask::PlayedTask(const PlayedTaskOptions& options, TaskInScene in_scene, const Model& model)
    : name_(options.task.name),
      viewed_(viewed_task(options.task, in_scene, model)),
      reader_(std::move(in_scene), options.ticks),
      trace_(viewed_.forces.size()) {}

Result<void> PlayedTask::observe(const RecordingPart& part) {
  return reader_.take(part, [this](const TickRecord& tick) {
    if (reader_.run().ticks() == 1) {
      ticks_.first = tick.tick;
      begin_s_ = tick.time_s;
    }
    ticks_.last = tick.tick;
    end_s_ = tick.time_s;
    trace_.observe(reader_.run());
    if (stored_.empty() || tick.time_s >= stored_.back().at_s + period_s_) store_moment(tick.time_s);
  });
}

void PlayedTask::store_moment(double time_s) {
  stored_.push_back({time_s, viewed_run(reader_.run(), name_, kOnlyRun)});
  stored_.back().run.events.clear();
  if (stored_.size() < kMaxMoments) return;
  // halve the number of samples and double the period
  std::size_t remaining = 0;
  for (std::size_t n = 0; n < stored_.size(); n += 2) stored_[remaining++] = std::move(stored_[n]);
  stored_.resize(remaining);
  period_s_ *= 2;
}

Result<void> PlayedTask::finish(bool is_whole) {
  const TaskEvaluator& run = reader_.run();
  if (run.ticks() == 0)
    return Error{ErrorKind::kBadInput, "the recording has none of the selected ticks", "",
                 "leave out --from-tick and --to-tick, or give those of a run as printed by palpate explore"};
  store_moment(end_s_);
  trace_.finish(run);
  score_ = reader_.score(is_whole);
  FinishedRun finished{
      {name_, kOnlyRun, run.ended() ? RunEnd::kTask : RunEnd::kSession, {}, score_, ticks_, 0, nullptr}, {}};
  finished.history = history_of(run.task().file, {finished.run});
  debriefing_ = std::make_shared<const ViewedDebriefing>(debriefed(run, trace_, finished));
  return {};
}

ViewedTraining PlayedTask::at(double time_s) const {
  if (time_s < begin_s_) return {};
  const auto after = std::ranges::upper_bound(stored_, time_s, {}, &StoredProgress::at_s);
  ViewedTraining run = std::prev(after)->run;
  const auto later = std::ranges::upper_bound(score_.events, time_s - begin_s_, {}, &TaskEvent::time_s);
  const bool is_over = time_s >= end_s_;
  report_events({score_.events.begin(), later}, is_over ? score_.more_events : 0, run);
  if (is_over) run.phase = ViewedTraining::Phase::kOver;
  return run;
}

}  // namespace palpate
