#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace palpate::volume_io {

/// Voxels of a structure as runs of consecutive indices, slice by slice.
class VoxelRuns {
 public:
  /// @param first_slice  lowest slice that may contain voxels
  explicit VoxelRuns(int first_slice = 0) : first_slice_(first_slice) {}

  /// Adds voxel i + j * dims[0] of the current slice, in ascending order.
  void add(std::uint32_t voxel) {
    const std::size_t begin = ends_.empty() ? 0 : ends_.back();
    if (runs_.size() > begin && runs_.back().first + runs_.back().count == voxel)
      ++runs_.back().count;
    else
      runs_.push_back({voxel, 1});
    ++count_;
  }
  void end_slice() { ends_.push_back(runs_.size()); }

  /// Calls visit(i + j * dims[0]) once for each voxel of a slice.
  template <class Visit>
  void read_slice(int slice, const Visit& visit) const {
    const auto at = static_cast<std::size_t>(slice - first_slice_);
    if (slice < first_slice_ || at >= ends_.size()) return;
    const std::size_t begin = at == 0 ? 0 : ends_[at - 1];
    for (const Run& run : std::span(runs_).subspan(begin, ends_[at] - begin))
      for (std::uint32_t n = 0; n < run.count; ++n) visit(std::size_t{run.first} + n);
  }
  std::uint64_t count() const { return count_; }

 private:
  struct Run {
    std::uint32_t first = 0, count = 0;
  };
  int first_slice_;
  std::vector<std::size_t> ends_;  // end of each slice in runs_, from first_slice_ on
  std::vector<Run> runs_;
  std::uint64_t count_ = 0;
};

}  // namespace palpate::volume_io
