#pragma once

#include <cstdint>
#include <vector>

#include "palpate/volume/slices.h"
#include "surfaces/surface_position.h"

namespace palpate::internal {

/// Options for the depth of a set of labels: the distance from each voxel inside to the outside.
struct DepthOptions {
  double reach_mm;  ///< Depth up to which positions are exact
  double sigma_mm;  ///< Width of the PositionFilter
  int threads;
};

/// Smoothed signed distance of a set over a box, in steps of kSurfaceStep_mm: negative inside, with the
/// mask's sign. Outside, it is cut off at less than the reach, which does not affect depths.
/// @param span  the box; its first voxel is voxel (0, 0, 0) of the bricks; values in the bricks' border are
///              undefined
/// Errors: kBadInput for insufficient memory; kInterrupted.
Result<Bricks<std::int16_t>> set_position(const Bricks<LabelId>& labels, const std::vector<LabelId>& set,
                                          const DepthOptions& options, const Progress& progress,
                                          const ProgressSpan& stage, const Span3& span);

/// Distance around a set's voxels within which its position can depend on them.
Index3 position_window(const Eigen::Vector3d& spacing_mm, const DepthOptions& options);

/// Median over a label's ridge of the distance to the nearest centre outside it, at most `reach_mm`.
/// @param span  the label's bounding box
/// Errors: kBadInput for insufficient memory; kInterrupted.
Result<double> median_half_thickness_mm(const Bricks<LabelId>& labels, LabelId label, const Span3& span,
                                        double reach_mm, int threads, const Progress& progress,
                                        const ProgressSpan& stage);

}  // namespace palpate::internal
