#pragma once

#include <cmath>
#include <functional>
#include <span>
#include <vector>

#include "palpate/volume/slices.h"
#include "surfaces/pieces.h"
#include "surfaces/surface_components.h"
#include "surfaces/surface_net_distance.h"
#include "surfaces/surface_normal.h"
#include "surfaces/surface_position.h"

namespace palpate::internal {

/// Converts mm to the nearest number of steps.
inline std::int16_t to_steps(double mm) {
  return static_cast<std::int16_t>(std::lround(mm / kSurfaceStep_mm));
}

/// Source of steps: a whole grid, overlaid with a recomputed part.
struct StepsSource {
  const Bricks<std::int16_t>* bricks = nullptr;
  const PatchOf<std::int16_t>* over = nullptr;

  static StepsSource of(const Bricks<std::int16_t>& bricks) { return {.bricks = &bricks}; }
  StepsSource with(const PatchOf<std::int16_t>& patch) const {
    StepsSource s = *this;
    s.over = &patch;
    return s;
  }
};

/// Reads every step-th voxel of a source in a box of that coarser grid; `outside` beyond the source.
Block<std::int16_t> gather(const StepsSource& source, const Index3& step, const Span3& span,
                           std::int16_t outside);

/// Cells between the voxels of a box.
inline Span3 cells_of(const Span3& voxels) {
  Span3 cells = voxels;
  for (int a = 0; a < 3; ++a) cells.high[a] = std::max(cells.low[a], cells.high[a] - 1);
  return cells;
}

/// Destination of results: part of a grid, i fastest.
template <class T>
struct Target {
  T* values;
  Span3 span;
};

/// Parameters of a structure that do not depend on which part is prepared.
struct SurfacePlan {
  SurfacePlan(const GridGeometry& labels, const VoxelBox& box, const SurfaceOptions& options);
  /// Margin around a structure's voxels within which the position reaches its limit.
  static Index3 margin(const GridGeometry& labels, const SurfaceOptions& options);

  VoxelBox box;
  GridGeometry fine;
  NormalGrid normal;
  double reach_mm, broad_reach_mm;
  Index3 window, broad_window;  ///< Reach of the distance in voxels at reach_mm, and at broad_reach_mm
  PositionFilter position_filter;
  BroadFilter broad_filter;
  NormalFilter normal_filter;
  int threads;
};

/// A computation over a part of a grid. Results do not depend on how the part is cut into slabs.
struct SurfaceStage {
  Span3 part;
  std::function<void(const Span3& slab)> work;
  PieceMargins margins{};
  double cost = 1;  ///< Cost per item of the part, relative to a filtered voxel

  double total_cost() const { return cost * static_cast<double>(part.count()); }
};

/// Factory of the stages; referenced arguments must outlive them.
struct SurfaceStages {
  const SurfacePlan& plan;

  /// Signed distance to the nearest voxel centre of the other class, up to plan.reach_mm.
  /// @param without  runs of the label that count as outside (dropped components)
  SurfaceStage distance(const Bricks<LabelId>& labels, LabelId label, const std::vector<LabelRun>& without,
                        const Target<std::int16_t>& out) const;
  /// Filtered distance, whose zero crossings place the net's nodes initially.
  SurfaceStage crossings(const StepsSource& distance, const Target<std::int16_t>& out) const;
  /// Distance to the net, with the sign of `distance`.
  SurfaceStage position(const NetTriangles& net, const StepsSource& distance,
                        const Target<std::int16_t>& out) const;
  /// Marks (1) the voxels whose position may change because the net changed in a cell with a corner marked 1.
  /// @param corners  marks of the corners of changed cells
  /// @param was      position before the change
  SurfaceStage stale(const Block<std::uint8_t>& corners, const StepsSource& was,
                     const Target<std::uint8_t>& out) const;
  /// Distance to the net where it is stale, elsewhere the value of `was`.
  SurfaceStage updated_position(const NetTriangles& net, const StepsSource& distance, const StepsSource& was,
                                const Block<std::uint8_t>& stale, const Target<std::int16_t>& out) const;
  /// Position, clamped at plan.broad_reach_mm and smoothed by the broad filter, on the normal's grid.
  SurfaceStage broad(const StepsSource& position, const Target<std::int16_t>& out) const;
  /// Normal field: the broad distance, blended with the position where its gradient is misleading
  /// (NormalFilter), on the normal's grid.
  SurfaceStage normal(const StepsSource& broad, const StepsSource& position,
                      const Target<std::int16_t>& out) const;
  /// Squared greatest slope of the position in every stretch of kStretch cells along i.
  SurfaceStage slopes(const StepsSource& position, const Target<float>& out) const;

  /// Runs independent stages by slabs on the plan's threads, with a slab thickness that lets all threads
  /// finish together. Errors: kBadInput for insufficient memory; kInterrupted.
  Result<void> run(std::span<const SurfaceStage> stages, const Progress& progress,
                   const ProgressSpan& span) const;
  /// Runs a stage in pieces with limited memory (pieces.h). Errors: those of run().
  Result<void> run_in_pieces(const SurfaceStage& stage, const Progress& progress,
                             const ProgressSpan& span) const;
};

}  // namespace palpate::internal
