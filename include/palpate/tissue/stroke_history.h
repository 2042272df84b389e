#pragma once

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace palpate {

/// Maximum number of strokes that can be undone; earlier ones are permanent.
inline constexpr std::size_t kMaxUndoneStrokes = 100;

/// Undo history of a burr's strokes, in the order in which they were made. A stroke is the material cut from
/// the motor's start to its stop. The template argument determines what is stored for each.
///
/// A sweep with another stroke number than the last one begins a new stroke, and so does any sweep after an
/// undo or redo. A new stroke clears all undone ones.
template <class Stroke>
class StrokeHistory {
 public:
  /// Whether sweeps with this stroke number belong to last().
  bool continues(std::uint32_t number) const { return open_ && number_ == number; }
  /// Begins a stroke.
  /// @param largest  capacity, above 0; the oldest stroke is discarded
  Stroke& begin(std::uint32_t number, Stroke stroke, std::size_t largest = kMaxUndoneStrokes) {
    open_ = true;
    number_ = number;
    undone_.clear();
    if (done_.size() >= largest) done_.erase(done_.begin());
    return done_.emplace_back(std::move(stroke));
  }
  /// The last stroke. Must be preceded by begin().
  Stroke& last() { return done_.back(); }

  /// Undoes and returns the last stroke; null if there is none. Valid until the next call.
  Stroke* undo() { return move_last(done_, undone_); }
  /// Redoes and returns the last undone stroke; null if there is none.
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
  bool open_ = false;         // sweeps may be added to the last stroke
  std::uint32_t number_ = 0;  // number of the last stroke
};

}  // namespace palpate
