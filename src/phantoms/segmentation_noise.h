#pragma once

#include <cstdint>

#include "palpate/volume/volume.h"

/// The faults of a segmentation drawn by hand, slice by slice.
namespace palpate {

/// The axis across which slices were drawn: that of the widest spacing, k where all are equal.
int slice_axis(const GridGeometry& grid);

/// By how much a drawn border is off: a random displacement within the slice, smooth over a few millimetres,
/// alike in neighbouring slices (correlation 0.5) and not beyond. Depends on seed and place alone.
class BorderJitter {
 public:
  /// @param sigma_mm  standard deviation of each of the two components
  BorderJitter(const GridGeometry& grid, double sigma_mm, std::uint64_t seed);
  /// @param p_mm   from the grid's origin along its axes
  /// @param slice  index along slice_axis()
  Eigen::Vector3d displacement_mm(const Eigen::Vector3d& p_mm, int slice) const;
  /// No displacement is longer.
  double most_mm() const;
  int axis() const { return axis_; }

 private:
  double component(int which, double u_mm, double v_mm, int slice) const;

  int axis_;
  double sigma_mm_;
  std::uint64_t seed_;
};

/// Small discs within a slice, up to 1.5 mm in radius: `count` stray islands of the structures in the
/// background around them, and as many holes inside structures. None touches another, or a border, not even
/// at a corner. Fewer where there is no room: a structure that is thin has none for a hole.
void add_islands_and_holes(Volume<LabelId>& labels, std::uint64_t count, std::uint64_t seed);

}  // namespace palpate
