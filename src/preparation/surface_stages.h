#pragma once

#include <cmath>
#include <functional>

#include "preparation/gaussian_slices.h"
#include "preparation/surface_components.h"
#include "preparation/surface_normal.h"
#include "preparation/surface_position.h"

namespace palpate::internal {

/// The nearest number of steps.
inline std::int16_t to_steps(double mm) {
  return static_cast<std::int16_t>(std::lround(mm / kSurfaceStep_mm));
}

/// Where steps are read: a whole grid's, and over them those of a part that was made anew.
struct StepsSource {
  const std::int16_t* origin;  ///< of voxel (0, 0, 0)
  std::ptrdiff_t row, slice;
  Span3 grid;
  const PatchOf<std::int16_t>* over = nullptr;

  static StepsSource of(const Volume<std::int16_t>& volume);
  static StepsSource of(const PaddedVolume<std::int16_t>& volume);
  StepsSource with(const PatchOf<std::int16_t>& patch) const {
    StepsSource s = *this;
    s.over = &patch;
    return s;
  }
};

/// Where results are written: part of a grid, i fastest.
template <class T>
struct Target {
  T* values;
  Span3 span;
};

/// What is the same for a structure however often a part of it is prepared.
struct SurfacePlan {
  SurfacePlan(const GridGeometry& labels, const VoxelBox& box, const SurfaceOptions& options);
  /// How far beyond its voxels a structure's box has to go: there the position has reached its limit.
  static Index3 margin(const GridGeometry& labels, const SurfaceOptions& options);

  VoxelBox box;
  GridGeometry fine;
  NormalGrid normal;
  double reach_mm, broad_reach_mm;
  Index3 window, broad_window;  ///< of the distance, and of what the broad distance sees of it
  PositionFilter position_filter;
  BroadFilter broad_filter;
  NormalFilter normal_filter;
  int threads;
};

/// One stage after the other over a part of the grids, by slabs and on the plan's threads. A slab's values do
/// not depend on how the part is cut. Thickness 0: as thick as makes one slab a thread.
/// Errors: kBadInput when memory is short, kInterrupted.
struct SurfaceStages {
  const SurfacePlan& plan;
  int thickness;
  const Progress& progress;

  Result<void> distance(const Volume<LabelId>& labels, LabelId label, const std::vector<LabelRun>& without,
                        const Target<std::int16_t>& out, const ProgressSpan& span) const;
  Result<void> position(const StepsSource& distance, const Target<std::int16_t>& out,
                        const ProgressSpan& span) const;
  Result<void> broad(const StepsSource& distance, const Target<std::int16_t>& out,
                     const ProgressSpan& span) const;
  Result<void> normal(const StepsSource& broad, const StepsSource& position, const Target<std::int16_t>& out,
                      const ProgressSpan& span) const;
  Result<void> slopes(const StepsSource& position, const Target<float>& out, const ProgressSpan& span) const;

 private:
  Result<void> by_slabs(const Span3& part, const ProgressSpan& span,
                        const std::function<void(const Span3& slab)>& work) const;
};

}  // namespace palpate::internal
