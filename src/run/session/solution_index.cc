#include "session/solution_index.h"

#include <algorithm>

#include "palpate/tissue/displayed_law.h"

namespace palpate {

void SolutionIndex::observe(const RecordingPart& part, std::uint64_t row) {
  for (const RecordingEvent& event : part.events) {
    if (event.kind == RecordingEvent::Kind::kModel) laws_.on_event(event.change);
    if (event.kind == RecordingEvent::Kind::kTissueSolution && frames_.size() < kMaxPending)
      frames_.push_back({event.number, event.input_tick, event.frame_hash != RecordingEvent::kUnsolved});
  }
  // a solution is reported with ticks that follow its input tick
  const auto take_from = [&](std::span<const TickRecord> ticks, std::uint64_t first_row) {
    std::erase_if(frames_, [&](const Frame& frame) {
      const auto found = std::ranges::lower_bound(ticks, frame.input_tick, {}, &TickRecord::tick);
      if (found == ticks.end()) return false;
      if (found->tick == frame.input_tick)
        take(frame, *found, first_row + static_cast<std::uint64_t>(found - ticks.begin()));
      return true;
    });
  };
  if (part.ticks.empty()) return;
  take_from(before_, before_row_);
  take_from(part.ticks, row);
  before_.assign(part.ticks.begin(), part.ticks.end());
  before_row_ = row;
}

void SolutionIndex::take(const Frame& frame, const TickRecord& input, std::uint64_t row) {
  const bool rises =
      solutions_.empty() || (frame.number > solutions_.back().number && row > solutions_.back().row);
  if (!rises || solutions_.size() >= kMaxSolutions) return;
  // the solver starts afresh after a frame that it could not solve, which is shown at rest
  if (!frame.is_solved) {
    boxes_.push_back({});
    return;
  }
  Boxes boxes;
  if (!boxes_.empty()) boxes = boxes_.back();
  const auto devices = static_cast<std::size_t>(std::clamp(input.devices, 0, kMaxDevices));
  const Model& model = model_of(input.model_version);
  for (std::size_t d = 0; d < devices; ++d) boxes[d] = next_solver_box(model, input.device[d], boxes[d]);
  if (boxes_.empty() || boxes_.back() != boxes) boxes_.push_back(boxes);
  solutions_.push_back({frame.number, static_cast<std::uint32_t>(boxes_.size() - 1), row});
}

// model that the solver used in that version; where the outermost surfaces lie does not depend on the law
const Model& SolutionIndex::model_of(std::uint32_t version) {
  const TissueLaw law = laws_.at(version);
  const double cell_factor = laws_.cell_factor_at(version);
  const auto has_settings = [&](const Model& model) {
    return model.tissue_law == law && model.tissue_cell_factor == cell_factor;
  };
  if (has_settings(*model_)) return *model_;
  if (!other_ || !has_settings(*other_)) {
    other_ = displayed_under_law(*model_, law);
    other_->tissue_cell_factor = cell_factor;
  }
  return *other_;
}

std::span<const SolutionIndex::Solution> SolutionIndex::up_to(std::uint32_t number,
                                                              std::size_t max_count) const {
  const auto found = std::ranges::lower_bound(solutions_, number, {}, &Solution::number);
  if (found == solutions_.end() || found->number != number) return {};
  const std::size_t last = static_cast<std::size_t>(found - solutions_.begin()) + 1;
  const std::size_t first = last - std::min(last, max_count + 1);
  return std::span(solutions_).subspan(first, last - first);
}

}  // namespace palpate
