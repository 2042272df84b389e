#include "session/yield_index.h"

#include <algorithm>

namespace palpate {

void YieldIndex::see(const RecordingPart& part, std::uint64_t row) {
  for (const RecordingEvent& event : part.events) {
    const bool is_cut = event.kind == RecordingEvent::Kind::kModel &&
                        (event.change.tissue == ModelChange::kCut || event.change.is_of_stroke());
    // versions only rise, whatever a file says
    if (is_cut)
      cut_versions_.push_back(std::max(event.number, cut_versions_.empty() ? 0 : cut_versions_.back()));
    if (event.kind == RecordingEvent::Kind::kYield && told_.size() < kMostTold)
      told_.push_back({event.number, event.input_tick});
  }
  // a solution is told with ticks that follow the one that it was solved from
  const auto take_from = [&](std::span<const TickRecord> ticks, std::uint64_t first_row) {
    std::erase_if(told_, [&](const Told& told) {
      const auto found = std::ranges::lower_bound(ticks, told.input_tick, {}, &TickRecord::tick);
      if (found == ticks.end()) return false;
      if (found->tick == told.input_tick)
        take(told, *found, first_row + static_cast<std::uint64_t>(found - ticks.begin()));
      return true;
    });
  };
  if (part.ticks.empty()) return;
  take_from(before_, before_row_);
  take_from(part.ticks, row);
  before_.assign(part.ticks.begin(), part.ticks.end());
  before_row_ = row;
}

void YieldIndex::take(const Told& told, const TickRecord& input, std::uint64_t row) {
  const bool rises =
      solutions_.empty() || (told.number > solutions_.back().number && row > solutions_.back().row);
  if (!rises || solutions_.size() >= kMostSolutions) return;
  Boxes boxes;
  // what is cut is laid anew
  if (!solutions_.empty() && !is_cut_between(version_, input.model_version)) boxes = boxes_.back();
  version_ = input.model_version;
  const auto devices = static_cast<std::size_t>(std::clamp(input.devices, 0, kMaxDevices));
  for (std::size_t d = 0; d < devices; ++d) boxes[d] = next_yield_box(*model_, input.device[d], boxes[d]);
  if (boxes_.empty() || boxes_.back() != boxes) boxes_.push_back(boxes);
  solutions_.push_back({told.number, static_cast<std::uint32_t>(boxes_.size() - 1), row});
}

bool YieldIndex::is_cut_between(std::uint32_t version, std::uint32_t later) const {
  const auto next = std::ranges::upper_bound(cut_versions_, version);
  return next != cut_versions_.end() && *next <= later;
}

std::span<const YieldIndex::Solution> YieldIndex::up_to(std::uint32_t number, std::size_t most) const {
  const auto found = std::ranges::lower_bound(solutions_, number, {}, &Solution::number);
  if (found == solutions_.end() || found->number != number) return {};
  const std::size_t last = static_cast<std::size_t>(found - solutions_.begin()) + 1;
  const std::size_t first = last - std::min(last, most + 1);
  return std::span(solutions_).subspan(first, last - first);
}

}  // namespace palpate
