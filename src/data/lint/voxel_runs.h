#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/base/result.h"
#include "palpate/volume/slices.h"
#include "palpate/volume/volume.h"

/// Run-length encoding of label volumes along i. The cost of operations on borders grows with the number of
/// runs, not with the number of voxels.
namespace palpate::internal {

struct VoxelRun {
  int first, last;         ///< Indices along i, inclusive
  LabelId value;           ///< Label value; 0: background
  std::uint32_t node = 0;  ///< Index into the result of connect(), which sets it

  int length() const { return last - first + 1; }
};

/// Runs of equal value, in row order. Rows may have gaps where a mask excludes voxels.
class RunVolume {
 public:
  explicit RunVolume(const std::array<int, 3>& dims)
      : dims_(dims), slices_(static_cast<std::size_t>(dims[2])) {}

  const std::array<int, 3>& dims() const { return dims_; }
  /// Runs of a row, in ascending order; empty outside the grid.
  std::span<const VoxelRun> row(int j, int k) const {
    if (j < 0 || k < 0 || j >= dims_[1] || k >= dims_[2]) return {};
    const Slice& slice = slices_[static_cast<std::size_t>(k)];
    const auto n = static_cast<std::size_t>(j);
    return {slice.runs.data() + slice.row_start[n], slice.row_start[n + 1] - slice.row_start[n]};
  }
  std::span<VoxelRun> slice(int k) { return slices_[static_cast<std::size_t>(k)].runs; }
  /// Run that contains a voxel of the grid; null in a gap.
  const VoxelRun* find(int i, int j, int k) const;

  /// Appends the next row of a slice. Different slices may be filled by different threads.
  /// @param mask  included voxels, one byte each; null: all
  void append_row(int k, const LabelId* values, const std::uint8_t* mask);

 private:
  struct Slice {
    std::vector<VoxelRun> runs;
    std::vector<std::size_t> row_start{0};
  };
  std::array<int, 3> dims_;
  std::vector<Slice> slices_;
};

/// Encodes a whole volume, background included. Errors: kInterrupted.
Result<RunVolume> runs_of(const Volume<LabelId>& labels, int workers, const Progress& progress,
                          const ProgressSpan& span);

/// A connected component of one value. Labels are 26-connected (faces, edges and corners), background is
/// 6-connected (faces).
struct Component {
  LabelId value = 0;
  std::size_t voxels = 0;
  std::array<int, 3> first{0, 0, 0};                      ///< First voxel in memory order
  std::array<int, 3> box_min{0, 0, 0}, box_max{0, 0, 0};  ///< Bounding box, inclusive
  bool at_border = false;                                 ///< Whether it has a voxel on the outermost layer
                                                          ///< of the grid
};

/// Connected components of a run volume, ordered by their first run; sets `node` of each run.
std::vector<Component> connect(RunVolume& runs);

/// Calls visit(axis, a, b, faces, voxel) for each pair of adjacent runs of different value: `b` follows `a`
/// along `axis` and shares `faces` faces with it, the first of which is the lower face of `voxel` (indices)
/// of `b`. Runs must have no gaps.
template <class Visit>
void for_each_face(const RunVolume& runs, const Visit& visit) {
  const auto sweep = [&](int axis, std::span<const VoxelRun> before, std::span<const VoxelRun> now, int j,
                         int k) {
    for (std::size_t a = 0, b = 0; a < before.size() && b < now.size();) {
      const int from = std::max(before[a].first, now[b].first), to = std::min(before[a].last, now[b].last);
      if (before[a].value != now[b].value)
        visit(axis, before[a], now[b], to - from + 1, std::array<int, 3>{from, j, k});
      const bool advance_a = before[a].last <= to, advance_b = now[b].last <= to;
      a += advance_a;
      b += advance_b;
    }
  };
  for (int k = 0; k < runs.dims()[2]; ++k)
    for (int j = 0; j < runs.dims()[1]; ++j) {
      const auto now = runs.row(j, k);
      for (std::size_t n = 1; n < now.size(); ++n)
        visit(0, now[n - 1], now[n], 1, std::array<int, 3>{now[n].first, j, k});
      sweep(1, runs.row(j - 1, k), now, j, k);
      sweep(2, runs.row(j, k - 1), now, j, k);
    }
}

/// Morphology with a cube. Outside the grid its border is repeated.
struct CubeMorphology {
  RunVolume thin;   ///< Labelled voxels that no 2 x 2 x 2 cube of their own label covers
  RunVolume inner;  ///< Voxels, labelled or background, whose 26 neighbours all have their value
};
Result<CubeMorphology> cube_morphology(const Volume<LabelId>& labels, int workers, const Progress& progress,
                                       const ProgressSpan& span);

}  // namespace palpate::internal
