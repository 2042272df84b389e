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

/// The nearest number of steps.
inline std::int16_t to_steps(double mm) {
  return static_cast<std::int16_t>(std::lround(mm / kSurfaceStep_mm));
}

/// Where steps are read: a whole grid's, and over them those of a part that was made anew.
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

/// Steps of every step-th voxel of a source in a box of that coarser grid; `outside` beyond the source.
Block<std::int16_t> gather(const StepsSource& source, const Index3& step, const Span3& span,
                           std::int16_t outside);

/// The cells between the voxels of a box.
inline Span3 cells_of(const Span3& voxels) {
  Span3 cells = voxels;
  for (int a = 0; a < 3; ++a) cells.high[a] = std::max(cells.low[a], cells.high[a] - 1);
  return cells;
}

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

/// A stage over a part of a grid. A slab's values do not depend on how the part is cut.
struct SurfaceStage {
  Span3 part;
  std::function<void(const Span3& slab)> work;
  PieceMargins margins{};
  double cost = 1;  ///< of an item of the part, where a filtered voxel's is 1

  double total_cost() const { return cost * static_cast<double>(part.count()); }
};

/// The stages; what they are given outlives them.
struct SurfaceStages {
  const SurfacePlan& plan;

  SurfaceStage distance(const Bricks<LabelId>& labels, LabelId label, const std::vector<LabelRun>& without,
                        const Target<std::int16_t>& out) const;
  /// The distance filtered, which is 0 where the net's nodes begin.
  SurfaceStage crossings(const StepsSource& distance, const Target<std::int16_t>& out) const;
  /// The distance to the net, with the sign of `distance`.
  SurfaceStage position(const NetTriangles& net, const StepsSource& distance,
                        const Target<std::int16_t>& out) const;
  /// 1 where a position that `was` may be another when the net differs in cells whose corners are 1.
  SurfaceStage stale(const Block<std::uint8_t>& corners, const StepsSource& was,
                     const Target<std::uint8_t>& out) const;
  /// The distance to the net where that is stale, elsewhere as it `was`.
  SurfaceStage position_again(const NetTriangles& net, const StepsSource& distance, const StepsSource& was,
                              const Block<std::uint8_t>& stale, const Target<std::int16_t>& out) const;
  SurfaceStage broad(const StepsSource& position, const Target<std::int16_t>& out) const;
  SurfaceStage normal(const StepsSource& broad, const StepsSource& position,
                      const Target<std::int16_t>& out) const;
  SurfaceStage slopes(const StepsSource& position, const Target<float>& out) const;

  /// Stages that do not need each other, by slabs on the plan's threads: as thick as lets the threads end
  /// together.
  /// Errors: kBadInput when memory is short, kInterrupted.
  Result<void> run(std::span<const SurfaceStage> stages, const Progress& progress,
                   const ProgressSpan& span) const;
  /// A stage, in pieces that take little memory (pieces.h). Errors: likewise.
  Result<void> run_in_pieces(const SurfaceStage& stage, const Progress& progress,
                             const ProgressSpan& span) const;
};

}  // namespace palpate::internal
