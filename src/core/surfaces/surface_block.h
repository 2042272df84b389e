#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <memory>
#include <span>
#include <vector>

#include "palpate/surfaces/surfaces.h"

namespace palpate::internal {

using Index3 = std::array<int, 3>;

/// A half-open box of indices: low ... high - 1.
struct Span3 {
  Index3 low{0, 0, 0}, high{0, 0, 0};

  int size(int axis) const { return high[axis] - low[axis]; }
  bool empty() const { return size(0) <= 0 || size(1) <= 0 || size(2) <= 0; }
  std::size_t count() const {
    return empty() ? 0
                   : static_cast<std::size_t>(size(0)) * static_cast<std::size_t>(size(1)) *
                         static_cast<std::size_t>(size(2));
  }
  Span3 grown(const Index3& by) const {
    Span3 s = *this;
    for (int a = 0; a < 3; ++a) {
      s.low[a] -= by[a];
      s.high[a] += by[a];
    }
    return s;
  }
  Span3 clipped(const Span3& to) const {
    Span3 s = *this;
    for (int a = 0; a < 3; ++a) {
      s.low[a] = std::max(s.low[a], to.low[a]);
      s.high[a] = std::max(s.low[a], std::min(s.high[a], to.high[a]));
    }
    return s;
  }
};

inline Span3 full_span(const GridGeometry& grid) {
  return {{0, 0, 0}, grid.dims};
}
inline VoxelBox to_box(const Span3& s) {
  return {s.low, {s.size(0), s.size(1), s.size(2)}};
}
inline Span3 to_span(const VoxelBox& b) {
  return {b.first, {b.first[0] + b.size[0], b.first[1] + b.size[1], b.first[2] + b.size[2]}};
}

/// Values over a box of indices, i fastest.
template <class T>
class Block {
 public:
  /// Allocates uninitialised values.
  explicit Block(const Span3& span)
      : span_(span), count_(span.count()), values_(std::make_unique_for_overwrite<T[]>(count_)) {}
  Block(const Span3& span, T fill) : Block(span) { std::fill_n(values_.get(), count_, fill); }

  const Span3& span() const { return span_; }
  /// Value (i, j, k) is at row(j, k)[i - span().low[0]].
  T* row(int j, int k) { return values_.get() + offset(j, k); }
  const T* row(int j, int k) const { return values_.get() + offset(j, k); }
  std::span<T> values() { return {values_.get(), count_}; }
  std::span<const T> values() const { return {values_.get(), count_}; }

 private:
  std::size_t offset(int j, int k) const {
    return (static_cast<std::size_t>(k - span_.low[2]) * static_cast<std::size_t>(span_.size(1)) +
            static_cast<std::size_t>(j - span_.low[1])) *
           static_cast<std::size_t>(span_.size(0));
  }

  Span3 span_;
  std::size_t count_;
  std::unique_ptr<T[]> values_;
};

/// Calls visit(j, k) for every row of a box, in memory order.
template <class Visit>
void for_each_row(const Span3& span, const Visit& visit) {
  if (span.empty()) return;
  for (int k = span.low[2]; k < span.high[2]; ++k) {
    for (int j = span.low[1]; j < span.high[1]; ++j) visit(j, k);
  }
}
/// Calls visit(j, k, row) for every row of a box of labels, in memory order; voxel i is row[i - span.low[0]].
template <class Visit>
void for_each_row(const Bricks<LabelId>& labels, const Span3& span, const Visit& visit) {
  if (span.empty()) return;
  std::vector<LabelId> row(static_cast<std::size_t>(span.size(0)));
  for_each_row(span, [&](int j, int k) {
    labels.copy_row(span.low[0], j, k, span.size(0), row.data());
    visit(j, k, static_cast<const LabelId*>(row.data()));
  });
}

}  // namespace palpate::internal
