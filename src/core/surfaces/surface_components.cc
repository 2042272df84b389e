#include "surfaces/surface_components.h"

#include <limits>
#include <numeric>

#include "palpate/base/disjoint_sets.h"

namespace palpate::internal {

namespace {

void grow(Span3& span, int first, int last, int j, int k) {
  const Index3 low{first, j, k}, high{last + 1, j + 1, k + 1};
  const bool fresh = span.empty();
  for (int a = 0; a < 3; ++a) {
    span.low[a] = fresh ? low[a] : std::min(span.low[a], low[a]);
    span.high[a] = fresh ? high[a] : std::max(span.high[a], high[a]);
  }
}

/// Range of runs of each row.
class RowIndex {
 public:
  explicit RowIndex(const Span3& span) : span_(span) {}
  void end_row(std::size_t runs) { end_.push_back(runs); }
  /// First and end of the runs of a row already read; empty outside the box.
  std::pair<std::size_t, std::size_t> row(int j, int k) const {
    if (j < span_.low[1] || j >= span_.high[1] || k < span_.low[2]) return {0, 0};
    const std::size_t n =
        static_cast<std::size_t>(k - span_.low[2]) * static_cast<std::size_t>(span_.size(1)) +
        static_cast<std::size_t>(j - span_.low[1]);
    return {n == 0 ? 0 : end_[n - 1], end_[n]};
  }

 private:
  Span3 span_;
  std::vector<std::size_t> end_;
};

}  // namespace

Components find_components(const Bricks<LabelId>& labels, LabelId label, const Span3& within) {
  Components found;
  DisjointSets sets;
  RowIndex index(within);
  for_each_row(labels, within, [&](int j, int k, const LabelId* row) {
    const auto has_label = [&](int i) { return row[i - within.low[0]] == label; };
    const std::size_t begin = found.runs.size();
    for (int i = within.low[0]; i < within.high[0];) {
      if (!has_label(i)) {
        ++i;
        continue;
      }
      const int first = i;
      while (i < within.high[0] && has_label(i)) ++i;
      sets.add();
      found.runs.push_back({first, i - 1, j, k, static_cast<std::uint32_t>(found.runs.size())});
    }
    index.end_row(found.runs.size());

    // connect to adjacent rows that were read before
    for (const auto& [dj, dk] : {std::pair{-1, 0}, {-1, -1}, {0, -1}, {1, -1}}) {
      auto [other, end] = index.row(j + dj, k + dk);
      for (std::size_t n = begin; n < found.runs.size(); ++n) {
        const LabelRun& run = found.runs[n];
        while (other < end && found.runs[other].last + 1 < run.first) ++other;
        for (std::size_t o = other; o < end && found.runs[o].first <= run.last + 1; ++o) {
          sets.join(static_cast<std::uint32_t>(n), static_cast<std::uint32_t>(o));
        }
      }
    }
  });

  // components are numbered in the order of their root runs
  std::vector<std::uint32_t> number(found.runs.size());
  for (std::size_t n = 0; n < found.runs.size(); ++n) {
    LabelRun& run = found.runs[n];
    const std::uint32_t root = sets.root(static_cast<std::uint32_t>(n));
    if (root == n) {
      number[n] = static_cast<std::uint32_t>(found.all.size());
      found.all.emplace_back();
    }
    run.component = number[root];
    Component& c = found.all[run.component];
    const double length = run.last - run.first + 1;
    c.voxels += static_cast<std::size_t>(length);
    grow(c.span, run.first, run.last, run.j, run.k);
    c.index_sum += length * Eigen::Vector3d(0.5 * (run.first + run.last), run.j, run.k);
  }
  return found;
}

std::vector<Span3> label_spans(const Bricks<LabelId>& labels) {
  std::vector<Span3> spans(std::size_t{std::numeric_limits<LabelId>::max()} + 1);
  const int length = labels.geometry().dims[0];
  for_each_row(labels, full_span(labels.geometry()), [&](int j, int k, const LabelId* row) {
    for (int i = 0; i < length;) {
      const LabelId label = row[i];
      const int first = i;
      while (i < length && row[i] == label) ++i;
      if (label != 0) grow(spans[label], first, i - 1, j, k);
    }
  });
  return spans;
}

}  // namespace palpate::internal
