#include "session/clearance_history.h"

#include <limits>

namespace palpate {

void ClearanceHistory::observe(std::span<const TickRecord> ticks, std::span<const RecordingEvent> events) {
  for (const RecordingEvent& event : events)
    if (event.kind == RecordingEvent::Kind::kSweep && event.sweep.device != Cut::kBrokenOff)
      waiting_.push_back(event);
  for (const TickRecord& tick : ticks) {
    for (; !waiting_.empty() && waiting_.front().tick <= tick.tick; waiting_.pop_front())
      meter_.observe(cut_of(waiting_.front().sweep).sweep);
    meter_.observe(tick);
    for (const auto& [label, mm] : meter_.nearest_mm()) {
      double& reported_mm =
          reported_mm_.try_emplace(label, std::numeric_limits<double>::infinity()).first->second;
      const bool touches = mm == 0 && reported_mm > 0;
      if (!touches && !(mm <= reported_mm - kStep_mm)) continue;
      reported_mm = mm;
      nearer_.push_back({tick.time_s, label, mm});
    }
  }
}

std::map<LabelId, double> ClearanceHistory::at(double time_s) const {
  std::map<LabelId, double> nearest_mm;
  for (const Nearer& one : nearer_) {
    if (one.time_s > time_s) break;
    nearest_mm[one.label] = one.mm;
  }
  return nearest_mm;
}

}  // namespace palpate
