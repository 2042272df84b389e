#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "lint/voxel_runs.h"

/// A set of voxels with one bit per voxel, for morphology with balls: 64 voxels per operation.
namespace palpate::internal {

class VoxelBits {
 public:
  explicit VoxelBits(const std::array<int, 3>& dims);

  const std::array<int, 3>& dims() const { return dims_; }
  bool at(int i, int j, int k) const { return (row(j, k)[i >> 6] >> (i & 63) & 1) != 0; }
  void set(int i, int j, int k) { row(j, k)[i >> 6] |= std::uint64_t{1} << (i & 63); }
  void set_run(int first, int last, int j, int k);
  /// Whether any of the voxels first ... last of a row is in the set.
  bool any(int first, int last, int j, int k) const;
  bool empty() const;
  void invert();

  /// Dilation by a ball: all voxels whose centre is within `radius_mm` of the centre of a voxel of the set.
  /// Grid axes are assumed perpendicular. Errors: kInterrupted.
  Result<VoxelBits> dilated(double radius_mm, const Eigen::Vector3d& spacing_mm, int workers,
                            const Progress& progress, const ProgressSpan& span) const;
  /// Run-length form of the set, with value 0, so that connect() joins by faces.
  RunVolume runs() const;

 private:
  std::uint64_t* row(int j, int k) { return words_.data() + offset(j, k); }
  const std::uint64_t* row(int j, int k) const { return words_.data() + offset(j, k); }
  std::size_t offset(int j, int k) const {
    return (static_cast<std::size_t>(k) * static_cast<std::size_t>(dims_[1]) + static_cast<std::size_t>(j)) *
           words_per_row_;
  }
  void clear_beyond();

  std::array<int, 3> dims_;
  std::size_t words_per_row_;
  std::vector<std::uint64_t> words_;
};

}  // namespace palpate::internal
