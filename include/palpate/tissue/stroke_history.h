#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace palpate {

/// So many strokes of a burr can be undone; what came before them stays.
inline constexpr std::size_t kMostUndone = 100;

/// The strokes of a burr that can be undone and done again, in the order in which they were done. A stroke is
/// what is cut from the motor's start to its stop. Whoever keeps a history decides what is remembered of
/// each.
///
/// Sweeps of another stroke than the last sweep's begin a new one; so does whatever is cut after an undo or a
/// redo. What was undone before a new stroke cannot be done again any more.
template <class Stroke>
class StrokeHistory {
 public:
  /// Whether sweeps of the stroke with this number belong to last().
  bool goes_on(std::uint32_t number) const { return open_ && number_ == number; }
  /// Another stroke. @param most  as many are remembered, the oldest are forgotten; above 0
  Stroke& begin(std::uint32_t number, Stroke stroke, std::size_t most = kMostUndone) {
    open_ = true;
    number_ = number;
    undone_.clear();
    if (done_.size() >= most) done_.erase(done_.begin());
    return done_.emplace_back(std::move(stroke));
  }
  /// The last one that is done. There is one after begin().
  Stroke& last() { return done_.back(); }

  /// The stroke that is undone with that; null: there is none. Valid until the next call.
  Stroke* undo() { return move_last(done_, undone_); }
  /// The stroke that is done again.
  Stroke* redo() { return move_last(undone_, done_); }

  const std::vector<Stroke>& done() const { return done_; }
  const std::vector<Stroke>& undone() const { return undone_; }

 private:
  Stroke* move_last(std::vector<Stroke>& from, std::vector<Stroke>& to) {
    if (from.empty()) return nullptr;
    to.push_back(std::move(from.back()));
    from.pop_back();
    open_ = false;
    return &to.back();
  }

  std::vector<Stroke> done_, undone_;
  bool open_ = false;         // sweeps may still be added to the last stroke
  std::uint32_t number_ = 0;  // of it
};

}  // namespace palpate
