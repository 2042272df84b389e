#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "palpate/tissue/carving.h"
#include "palpate/tissue/tissue_settings.h"

/// Distance field of a surface around the material that sweeps remove, in a box of the field's grid.
namespace palpate::internal {

using Steps = std::int16_t;
using Index = Eigen::Array3i;

/// Range of voxels of a grid.
class Box {
 public:
  Box(const Index& low, const Index& high) : low_(low), size_((high - low).max(0)) {}

  const Index& low() const { return low_; }
  Index high() const { return low_ + size_; }
  const Index& size() const { return size_; }
  bool empty() const { return (size_ == 0).any(); }
  std::size_t count() const { return empty() ? 0 : static_cast<std::size_t>(size_.cast<long>().prod()); }
  Box grown(const Index& by) const { return {low_ - by, high() + by}; }
  Box clipped(const Box& to) const { return {low_.max(to.low_), high().min(to.high())}; }
  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k - low_[2]) * static_cast<std::size_t>(size_[1]) +
            static_cast<std::size_t>(j - low_[1])) *
               static_cast<std::size_t>(size_[0]) +
           static_cast<std::size_t>(i - low_[0]);
  }
  VoxelBox voxels() const { return {{low_[0], low_[1], low_[2]}, {size_[0], size_[1], size_[2]}}; }

 private:
  Index low_, size_;
};

inline Box whole(const GridGeometry& grid) {
  return {Index::Zero(), Index(grid.dims[0], grid.dims[1], grid.dims[2])};
}

inline std::vector<Steps> read(const Bricks<Steps>& bricks, const Box& box) {
  std::vector<Steps> values(box.count());
  if (box.empty()) return values;
  for (int k = box.low()[2]; k < box.high()[2]; ++k)
    for (int j = box.low()[1]; j < box.high()[1]; ++j)
      bricks.copy_row(box.low()[0], j, k, box.size()[0], &values[box.offset(box.low()[0], j, k)]);
  return values;
}

/// Voxels near a surface, with their signed distances (negative inside).
class NearSurfaceVoxels {
  // Eigen expression; bit-identical for any SIMD width, because roots and sums are rounded exactly.
  auto distances_mm(const Eigen::Array3f& at_mm) const {
    return ((voxels_.col(0).head(size_) - at_mm[0]).square() +
            (voxels_.col(1).head(size_) - at_mm[1]).square() +
            (voxels_.col(2).head(size_) - at_mm[2]).square())
               .sqrt() +
           voxels_.col(3).head(size_);
  }

 public:
  NearSurfaceVoxels() = default;
  /// Allocates `count` entries for set().
  explicit NearSurfaceVoxels(std::size_t count)
      : voxels_(static_cast<Eigen::Index>(count), 4), size_(static_cast<Eigen::Index>(count)) {}
  /// @param at_mm  position from the grid's first voxel, along its axes
  void set(std::size_t n, const Eigen::Array3f& at_mm, float distance_mm) {
    voxels_.row(static_cast<Eigen::Index>(n)) << at_mm[0], at_mm[1], at_mm[2], distance_mm;
  }

  Eigen::Index size() const { return size_; }
  /// Least sum of a stored voxel's distance from `at_mm` and its own distance to the surface.
  float distance_mm(const Eigen::Array3f& at_mm) const {
    return size_ == 0 ? std::numeric_limits<float>::infinity() : distances_mm(at_mm).minCoeff();
  }
  /// Replaces the voxels by those of `all` that can have the least sum for a point within `radius_mm` of
  /// `at_mm`, if the sum is below `max_mm` there. Memory is kept from call to call.
  void select(const NearSurfaceVoxels& all, const Eigen::Array3f& at_mm, float radius_mm, float max_mm) {
    size_ = 0;
    if (all.size_ == 0) return;
    if (voxels_.rows() < all.size_) {
      voxels_.resize(all.size_, 4);
      paths_.resize(all.size_);
    }
    auto paths = paths_.head(all.size_);
    paths = all.distances_mm(at_mm);
    // margin for rounding
    const float largest = std::min(max_mm + radius_mm, paths.minCoeff() + 2 * radius_mm) + 1e-3f;
    std::array<float*, 4> to;
    std::array<const float*, 4> from;
    for (std::size_t column = 0; column < 4; ++column) {
      to[column] = voxels_.col(static_cast<Eigen::Index>(column)).data();
      from[column] = all.voxels_.col(static_cast<Eigen::Index>(column)).data();
    }
    // without branches: an entry that is not selected is overwritten by the next one
    for (Eigen::Index n = 0; n < all.size_; ++n) {
      for (std::size_t column = 0; column < 4; ++column) to[column][size_] = from[column][n];
      size_ += paths_[n] <= largest ? 1 : 0;
    }
  }

 private:
  Eigen::Array<float, Eigen::Dynamic, 4> voxels_;  // position and distance; the first size_ rows are in use
  Eigen::ArrayXf paths_;                           // scratch memory of select()
  Eigen::Index size_ = 0;
};

template <class F>
void for_voxels(const Box& box, const F& run_at) {
  F run = run_at;
  for (int k = box.low()[2]; k < box.high()[2]; ++k)
    for (int j = box.low()[1]; j < box.high()[1]; ++j)
      for (int i = box.low()[0]; i < box.high()[0]; ++i) run(i, j, k);
}

/// New position values of a surface in a box of its grid.
class CarvedBlock {
 public:
  /// @param now  position after earlier sweeps
  /// @param cut  depth within the earlier sweeps
  CarvedBlock(const SignedField& original, const Bricks<Steps>& now, const Bricks<Steps>& cut,
              std::span<const Sweep> sweeps,
              std::span<const std::shared_ptr<const Surface>> protected_surfaces);

  bool empty() const { return changing_.empty(); }

  PatchOf<Steps> cut() const;

  /// Position values of all voxels that may have changed.
  PatchOf<Steps> position();

 private:
  double reach_mm() const { return far_ * step_mm_; }
  Index voxels_in(double mm) const { return (mm / grid_.spacing_mm.array()).ceil().cast<int>() + 1; }

  // voxels that the sweeps can change: within the range of the distance field around the removed material
  Box reached(const SignedField& original, std::span<const Sweep> sweeps) const;

  std::vector<Steps> combined_depth() const;

  void apply_sweep(const Sweep& sweep, const Transform<Voxel, Patient>& X_VoxelPatient);

  // excludes a protected structure from the cuts
  void exclude_protected(const Surface& protected_surface);

  // dilation: whether the predicate holds for a voxel or one of its 26 neighbours
  template <class F>
  std::vector<char> dilate(const std::vector<Steps>& values, const F& is_so) const;

  // the selected voxels that are near the surface
  NearSurfaceVoxels nearby(const std::vector<Steps>& values, const std::vector<char>& selected) const;
  // voxels that have changed since the last version, with their neighbours
  NearSurfaceVoxels removed_material() const;

  Eigen::Array3f position_mm(int i, int j, int k) const {
    return (Eigen::Array3d(i, j, k) * grid_.spacing_mm.array()).cast<float>();
  }

  /// Candidates for the values of a block: near the prepared surface, near the current one, and near material
  /// removed since the last version.
  struct Surroundings {
    NearSurfaceVoxels original, current, removed;
  };
  // Selects the candidates for a block. False if no distance in the block can have changed.
  bool select_surroundings(const Surroundings& all, const Box& block, Surroundings& selected) const;

  // Fills a box by blocks. Candidates are selected for large blocks first, then for those of half the edge
  // inside.
  // @param level  index into kEdges
  void fill_blocks(const Box& box, std::size_t level, const Surroundings& around);

  void fill(const Box& block, const Surroundings& around);
  int in_steps(float mm) const {
    return static_cast<int>(std::lround(std::min(static_cast<double>(mm), reach_mm()) / step_mm_));
  }

  template <class F>
  static void for_blocks(const Box& box, int size, const F& run);

  static constexpr std::array<int, 5> kEdges{32, 16, 8, 4, 2};

  GridGeometry grid_;
  Transform<Patient, Voxel> X_PatientVoxel_;
  double step_mm_;
  Steps far_;
  double band_mm_;
  Box changing_, read_;
  // in the box that is read: prepared position, depth in the sweeps, and their union before and after
  std::vector<Steps> original_, cut_, previous_, current_;
  std::vector<char> surface_band_;  // voxels that are inside now, or have a neighbour that is
  std::vector<Steps> position_;     // in the box that changes
  std::array<Surroundings, kEdges.size()> surroundings_;  // candidates for the current block of each level
};

}  // namespace palpate::internal
