#pragma once

#include <cstdint>

#include "palpate/volume/volume.h"

/// Errors of a segmentation drawn by hand, slice by slice.
namespace palpate {

/// Axis perpendicular to the drawn slices: that of the largest spacing, k if all are equal.
int slice_axis(const GridGeometry& grid);

/// Error of a drawn border: a random displacement within the slice, smooth over a few millimetres, correlated
/// between adjacent slices (0.5) only. Depends only on seed and position.
class BorderJitter {
 public:
  /// @param sigma_mm  standard deviation of each of the two components
  BorderJitter(const GridGeometry& grid, double sigma_mm, std::uint64_t seed);
  /// Displacement at a point.
  /// @param p_mm   position relative to the grid's origin, along its axes
  /// @param slice  index along slice_axis()
  Eigen::Vector3d displacement_mm(const Eigen::Vector3d& p_mm, int slice) const;
  /// Upper bound of the displacement; mm.
  double max_mm() const;
  int axis() const { return axis_; }

 private:
  double component(int which, double u_mm, double v_mm, int slice) const;

  int axis_;
  double sigma_mm_;
  std::uint64_t seed_;
};

/// Adds small discs within slices, up to 1.5 mm in radius: `count` stray islands of structures in the
/// background around them, and `count` holes in structures. None touches another or a border, not even at a
/// corner. Fewer are added if there is no space: a thin structure has none for a hole.
void add_islands_and_holes(Volume<LabelId>& labels, std::uint64_t count, std::uint64_t seed);

}  // namespace palpate
