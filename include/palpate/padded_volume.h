#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

#include "palpate/volume.h"

namespace palpate {

/// Voxel (i, j, k) of a PaddedVolume stands at origin[i + j * row + k * slice].
template <class T>
struct VoxelView {
  const T* origin;
  std::ptrdiff_t row, slice;
};

/// Voxels on a grid with a border of four more on every side, so that whoever reads a point's
/// neighbourhood need not ask whether its voxels exist. Memory is linear, i fastest; the border that
/// ends a row is the one that begins the next, and so are those of slices:
///
///     row j    |border|0 1 2 ... dims[0]-1|border|
///     row j+1                             |border|0 1 2 ... dims[0]-1|border|
///
/// It costs 6 % of a volume of 256 x 256 x 124. Writing into a border of i writes into both rows.
template <class T>
class PaddedVolume {
 public:
  static constexpr int kBorder = 4;

  /// Nothing but border.
  PaddedVolume() : PaddedVolume(GridGeometry{}, T{}) {}
  /// Every voxel of the grid and its border holds `fill`.
  PaddedVolume(const GridGeometry& geometry, T fill)
      : geometry_(geometry),
        row_(geometry.dims[0] + kBorder),
        slice_(row_ * (geometry.dims[1] + kBorder)),
        voxels_(
            static_cast<std::size_t>(kBorder * (1 + row_ + slice_) +
                                     offset(geometry.dims[0] + kBorder - 1, geometry.dims[1] + kBorder - 1,
                                            geometry.dims[2] + kBorder - 1) +
                                     1),
            fill) {}
  /// The voxels of a volume, `outside` in the border.
  PaddedVolume(const Volume<T>& volume, T outside) : PaddedVolume(volume.geometry(), outside) {
    const auto length = static_cast<std::ptrdiff_t>(geometry_.dims[0]);
    for_each_row([&](int j, int k) {
      const auto* begin = volume.voxels().data() + geometry_.offset(0, j, k);
      std::copy(begin, begin + length, &at(0, j, k));
    });
  }

  const GridGeometry& geometry() const { return geometry_; }
  /// Voxels in memory, border included.
  std::size_t stored_voxels() const { return voxels_.size(); }

  /// Any voxel from kBorder before the grid to kBorder beyond it, on every axis.
  const T& at(int i, int j, int k) const {
    return voxels_[static_cast<std::size_t>(lead() + offset(i, j, k))];
  }
  T& at(int i, int j, int k) { return voxels_[static_cast<std::size_t>(lead() + offset(i, j, k))]; }
  /// For whoever reads many voxels at once; valid as long as this volume is.
  VoxelView<T> view() const { return {voxels_.data() + lead(), row_, slice_}; }

  /// A copy without the border.
  Volume<T> unpadded() const {
    Volume<T> volume(geometry_);
    const auto length = static_cast<std::ptrdiff_t>(geometry_.dims[0]);
    for_each_row([&](int j, int k) {
      const T* begin = &at(0, j, k);
      std::copy(begin, begin + length, volume.voxels().data() + geometry_.offset(0, j, k));
    });
    return volume;
  }

 private:
  std::ptrdiff_t offset(int i, int j, int k) const { return i + j * row_ + k * slice_; }
  std::ptrdiff_t lead() const { return kBorder * (1 + row_ + slice_); }

  template <class Visit>
  void for_each_row(const Visit& visit) const {
    if (geometry_.dims[0] == 0) return;
    for (int k = 0; k < geometry_.dims[2]; ++k) {
      for (int j = 0; j < geometry_.dims[1]; ++j) visit(j, k);
    }
  }

  GridGeometry geometry_;
  std::ptrdiff_t row_, slice_;
  std::vector<T> voxels_;
};

}  // namespace palpate
