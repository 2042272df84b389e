#pragma once

#include <cstdint>
#include <vector>

#include "palpate/volume/slices.h"
#include "surfaces/surface_position.h"

namespace palpate::internal {

/// Depth of a set of labels: how far each of its voxels lies from what is not in it.
struct DepthOptions {
  double reach_mm;  ///< positions are right to this depth at least
  double sigma_mm;  ///< of PositionFilter
  int threads;
};

/// The smoothed signed distance of a set over a box, in steps of kSurfaceStep_mm: negative inside, its sign
/// the mask. Outside it is cut off nearer to the set than the reach, which no depth sees.
/// @param span  the box; its first voxel is voxel (0, 0, 0) of the bricks, what is around them means nothing
/// Errors: kBadInput when memory is short, kInterrupted.
Result<Bricks<std::int16_t>> set_position(const Bricks<LabelId>& labels, const std::vector<LabelId>& set,
                                          const DepthOptions& options, const Progress& progress,
                                          const ProgressSpan& stage, const Span3& span);

/// How far around a set's voxels its position can depend on them.
Index3 position_window(const Eigen::Vector3d& spacing_mm, const DepthOptions& options);

/// The median over a label's ridge of the distance to the nearest centre outside it, at most `reach_mm`.
/// @param span  the label's box
/// Errors: as above.
Result<double> median_half_thickness_mm(const Bricks<LabelId>& labels, LabelId label, const Span3& span,
                                        double reach_mm, int threads, const Progress& progress,
                                        const ProgressSpan& stage);

}  // namespace palpate::internal
