#include <algorithm>
#include <functional>
#include <vector>

#include "palpate/tasks/evaluator.h"

namespace palpate {

Result<void> RunReader::take(const RecordingPart& part,
                             const std::function<void(const TickRecord&)>& on_tick) {
  if (evaluator_.task().plan)
    pending_events_.insert(pending_events_.end(), part.events.begin(), part.events.end());
  for (const TickRecord& tick : part.ticks) {
    has_last_ = has_last_ || tick.tick >= range_.last;
    if (tick.tick > range_.last || evaluator_.ended()) continue;
    for (; !pending_events_.empty() && pending_events_.front().tick <= tick.tick; pending_events_.pop_front())
      evaluator_.on_event(pending_events_.front());
    if (tick.tick < range_.first) continue;
    if (auto observed = evaluator_.observe(tick); !observed) return observed;
    if (on_tick) on_tick(tick);
  }
  return {};
}

Result<TaskScore> score_recording(const TaskInScene& task, const RecordingSource& recording,
                                  const Progress& progress, const TickRange& range) {
  RunReader reader(task, range);
  const auto ticks = static_cast<double>(std::max<std::uint64_t>(recording.head().ticks, 1));
  double used = 0;
  const auto read = recording.read(
      [&](const RecordingPart& part) -> Result<void> {
        used += static_cast<double>(part.ticks.size());
        progress.report("scoring", used / ticks);
        return reader.take(part);
      },
      progress);
  if (!read) return read.error();
  if (reader.run().ticks() == 0 && recording.head().ticks > 0)
    return Error{ErrorKind::kBadInput, "it has none of the ticks to be scored", "",
                 "leave out --from-tick and --to-tick, or give those of a run as printed by palpate explore"};
  return reader.score(recording.head().summary.has_value());
}

int runs_in_a_row(const std::vector<bool>& in_band) {
  int count = 0;
  for (auto run = in_band.rbegin(); run != in_band.rend() && *run; ++run) ++count;
  return count;
}

}  // namespace palpate
