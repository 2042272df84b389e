#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <memory>
#include <vector>

#include "palpate/tissue/sweep.h"
#include "palpate/volume/bricks.h"

namespace palpate {

/// Set of sample points of a voxel grid that sweeps have covered: kSamples evenly spaced points per voxel, so
/// that repeated sweeps count once and the order does not matter. Copies share all unchanged data, so that a
/// version can be kept for every stroke.
class SweptSamples {
 public:
  static constexpr int kAlong = 4;     ///< Points per voxel along each axis
  static constexpr int kSamples = 64;  ///< Points per voxel, each a bit of `samples`

  /// Points of a voxel.
  struct VoxelSamples {
    int i, j, k;
    std::uint64_t samples;
  };

  /// @param labels  volume whose grid it has; null: an empty grid
  explicit SweptSamples(const Bricks<LabelId>* labels)
      : dims_(labels == nullptr ? std::array<int, 3>{} : labels->geometry().dims) {}

  /// Adds the points within a sweep, in voxels whose label is cut. Returns the newly covered ones, in an
  /// order that depends only on the sweep.
  /// @param labels  on the grid, before any removal
  /// @param is_cut  by label
  std::vector<VoxelSamples> add(const Sweep& sweep, const Bricks<LabelId>& labels,
                                const std::vector<bool>& is_cut);

  /// Position of sample point `n` of a voxel, 0 ... kSamples - 1.
  static Point<Voxel> sample_point(int i, int j, int k, int n);
  /// Covered points of a voxel; 0 outside the grid.
  std::uint64_t at(int i, int j, int k) const;
  /// Calls visit(i, j, k, samples) for every voxel with covered points.
  template <class Visit>
  void for_each(const Visit& visit) const {
    for (const auto& [number, block] : blocks_)
      for (std::size_t n = 0; n < block->size(); ++n)
        if (const std::uint64_t samples = (*block)[n]; samples != 0) {
          const std::array<int, 3> at = voxel_at(number, n);
          visit(at[0], at[1], at[2], samples);
        }
  }

 private:
  static constexpr int kEdge = 8;  // voxels of a block along each axis
  using Block = std::array<std::uint64_t, std::size_t{kEdge} * kEdge * kEdge>;

  std::size_t block_of(int i, int j, int k) const;
  static std::size_t index_in_block(int i, int j, int k);
  std::array<int, 3> voxel_at(std::size_t block, std::size_t n) const;
  std::uint64_t* samples_of(int i, int j, int k);

  std::array<int, 3> dims_;
  std::map<std::size_t, std::shared_ptr<Block>> blocks_;  // by block index; blocks without points are absent
};

}  // namespace palpate
