#include "session/cut_list.h"

#include <algorithm>
#include <limits>

#include "palpate/base/check.h"

namespace palpate {

void CutList::reserve(std::size_t sweeps) {
  const auto make_room = [](auto& list, std::size_t more) {
    if (const std::size_t count = list.size() + more; count > list.capacity()) list.reserve(2 * count);
  };
  make_room(sweeps_, sweeps);
  make_room(versions_, sweeps);
  make_room(changes_, 1);
}

void CutList::add(std::uint32_t version, const SweepRecord& sweep) {
  PALPATE_CHECK(versions_.empty() || version >= versions_.back());
  sweeps_.push_back(sweep);
  versions_.push_back(version);
}

void CutList::add(std::uint32_t version, StrokeAction action) {
  PALPATE_CHECK(changes_.empty() || version >= changes_.back().version);
  changes_.push_back({version, action, sweeps_.size()});
}

std::size_t CutList::sweeps_until(std::uint32_t version) const {
  return static_cast<std::size_t>(std::ranges::upper_bound(versions_, version) - versions_.begin());
}

// Replays all strokes from the first, linear in the number of sweeps. The result is cached until a version
// with another number of undos and redos is requested.
const CutList::InForce& CutList::in_force(std::uint32_t version) const {
  const auto later = std::ranges::upper_bound(changes_, version, {}, &Change::version);
  const auto changes = static_cast<std::size_t>(later - changes_.begin());
  if (last_.known && last_.changes == changes) return last_;
  StrokeHistory<Run> history;
  last_ = {};
  std::size_t next = 0;
  std::uint64_t left = 0;
  for (std::size_t n = 0; n < changes; ++n) {
    for (; next < changes_[n].sweeps; ++next, ++left) {
      const std::uint32_t stroke = sweeps_[next].stroke;
      if (!history.continues(stroke))
        history.begin(stroke, {next, next}, std::numeric_limits<std::size_t>::max());
      history.last().end = next + 1;
    }
    const bool undo = changes_[n].action == StrokeAction::kUndo;
    if (const Run* const run = undo ? history.undo() : history.redo())
      left = undo ? left - (run->end - run->begin) : left + (run->end - run->begin);
    if (undo) last_.undone_to.push_back(left);
  }
  last_.runs = history.done();
  last_.continues = next;
  last_.changes = changes;
  last_.known = true;
  return last_;
}

std::size_t CutList::count_at(std::uint32_t version) const {
  const InForce& in = in_force(version);
  std::size_t count = std::max(sweeps_until(version), in.continues) - in.continues;
  for (const Run& run : in.runs) count += run.end - run.begin;
  return count;
}

std::vector<SweepRecord> CutList::sweeps_at(std::uint32_t version, std::size_t first,
                                            std::size_t max_count) const {
  const InForce& in = in_force(version);
  std::vector<SweepRecord> some;
  const auto take = [&](std::size_t begin, std::size_t end) {
    const std::size_t skipped = std::min(first, end - begin);
    first -= skipped;
    const std::size_t count = std::min(max_count - some.size(), end - begin - skipped);
    const auto from = sweeps_.begin() + static_cast<std::ptrdiff_t>(begin + skipped);
    some.insert(some.end(), from, from + static_cast<std::ptrdiff_t>(count));
  };
  for (const Run& run : in.runs) take(run.begin, run.end);
  take(in.continues, std::max(sweeps_until(version), in.continues));
  return some;
}

}  // namespace palpate
