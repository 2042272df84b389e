#include <algorithm>
#include <span>

#include "palpate/base/disjoint_sets.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Connected components by run-length union-find. A run is a maximal interval of one value along i. Each run
/// is joined with the runs of equal value that share a face with it, in the previous row and in the same row
/// of the previous slice. Only those rows' runs are needed, so the volume is read once, sequentially, and
/// memory is proportional to the number of runs, not of voxels (base/disjoint_sets.h).
namespace palpate {
namespace {

struct Run {
  int first, last;  // inclusive, along i
  LabelId value;
  std::uint32_t node;  // element of the DisjointSets
};

// runs of one slice, row by row
struct SliceRuns {
  std::vector<Run> runs;
  std::vector<std::size_t> row_start;  // index of each row's first run, and the end: one more than rows

  std::span<const Run> row(int j) const {
    if (j < 0 || j + 1 >= static_cast<int>(row_start.size())) return {};
    const auto r = static_cast<std::size_t>(j);
    return {runs.data() + row_start[r], row_start[r + 1] - row_start[r]};
  }
  void clear() {
    runs.clear();
    row_start.assign(1, 0);
  }
};

// joins each run of `now` with the runs of equal value that overlap it in an adjacent row; both ascend in i
void join_rows(std::span<const Run> now, std::span<const Run> before, DisjointSets& forest) {
  std::size_t begin = 0;
  for (const Run& run : now) {
    while (begin < before.size() && before[begin].last < run.first) ++begin;
    for (std::size_t b = begin; b < before.size() && before[b].first <= run.last; ++b)
      if (before[b].value == run.value) forest.join(run.node, before[b].node);
  }
}

// accumulated over one value of one layer
struct Sums {
  std::size_t voxels = 0;
  std::array<int, 3> low{0, 0, 0}, high{0, 0, 0};
  std::array<std::uint64_t, 3> index_sum{0, 0, 0};
  int components = 0;
  std::size_t largest = 0;

  void add(const Run& run, int j, int k) {
    const auto length = static_cast<std::uint64_t>(run.last - run.first + 1);
    const std::array<int, 3> from{run.first, j, k}, to{run.last, j, k};
    for (std::size_t a = 0; a < 3; ++a) {
      low[a] = voxels == 0 ? from[a] : std::min(low[a], from[a]);
      high[a] = voxels == 0 ? to[a] : std::max(high[a], to[a]);
    }
    index_sum[0] += length * static_cast<std::uint64_t>(run.first + run.last) / 2;
    index_sum[1] += length * static_cast<std::uint64_t>(j);
    index_sum[2] += length * static_cast<std::uint64_t>(k);
    voxels += length;
  }
};

void find_runs(const LabelId* row, int count, DisjointSets& forest, std::vector<Run>& runs) {
  for (int i = 0; i < count;) {
    const LabelId value = row[i];
    int end = i + 1;
    while (end < count && row[end] == value) ++end;
    if (value != 0) runs.push_back({i, end - 1, value, forest.add()});
    i = end;
  }
}

// sums of a layer, indexed by value
std::vector<Sums> layer_sums(const Volume<LabelId>& layer) {
  const GridGeometry& grid = layer.geometry();
  std::vector<Sums> sums(65536);
  DisjointSets forest;
  std::vector<std::uint32_t> length;  // voxels of each run, by element
  std::vector<LabelId> value;
  SliceRuns now, before;
  now.clear();
  for (int k = 0; k < grid.dims[2]; ++k) {
    std::swap(now, before);
    now.clear();
    for (int j = 0; j < grid.dims[1]; ++j) {
      const std::size_t first_run = now.runs.size();
      find_runs(layer.voxels().data() + grid.offset(0, j, k), grid.dims[0], forest, now.runs);
      now.row_start.push_back(now.runs.size());
      for (std::size_t r = first_run; r < now.runs.size(); ++r) {
        const Run& run = now.runs[r];
        sums[run.value].add(run, j, k);
        length.push_back(static_cast<std::uint32_t>(run.last - run.first + 1));
        value.push_back(run.value);
      }
      join_rows(now.row(j), now.row(j - 1), forest);
      join_rows(now.row(j), before.row(j), forest);
    }
  }

  // sizes of the components
  std::vector<std::size_t> size(forest.size(), 0);
  for (std::uint32_t n = 0; n < forest.size(); ++n) size[forest.root(n)] += length[n];
  for (std::size_t n = 0; n < size.size(); ++n) {
    if (size[n] == 0) continue;
    Sums& s = sums[value[n]];
    ++s.components;
    s.largest = std::max(s.largest, size[n]);
  }
  return sums;
}

}  // namespace

std::vector<SegmentStatistics> segment_statistics(const LabelMap& labels) {
  const GridGeometry& grid = labels.geometry();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  std::vector<SegmentStatistics> all;
  for (std::size_t layer = 0; layer < labels.layers.size(); ++layer) {
    const std::vector<Sums> sums = layer_sums(labels.layers[layer]);
    for (const Segment& segment : labels.segments) {
      const Sums& s = sums[segment.value];
      if (segment.layer != static_cast<int>(layer) || segment.value == 0 || s.voxels == 0) continue;
      const auto n = static_cast<double>(s.voxels);
      SegmentStatistics one;
      one.id = segment.id;
      one.voxels = s.voxels;
      one.volume_mm3 = n * grid.voxel_volume_mm3();
      one.box_min = s.low;
      one.box_max = s.high;
      one.centroid = X_PatientVoxel * Point<Voxel>(static_cast<double>(s.index_sum[0]) / n,
                                                   static_cast<double>(s.index_sum[1]) / n,
                                                   static_cast<double>(s.index_sum[2]) / n);
      one.components = s.components;
      one.largest_component_voxels = s.largest;
      all.push_back(one);
    }
  }
  std::sort(all.begin(), all.end(),
            [](const SegmentStatistics& a, const SegmentStatistics& b) { return a.id < b.id; });
  return all;
}

}  // namespace palpate
