#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/sampling/surface.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Builds surfaces for contact from labels, and updates them where tissue was removed.
///
///     labels == id -> signed distance -> filtered -> surface net, smooth within the voxels' constraints
///                                                                  |
///     position: the distance to the net <--------------------------+
///         +-> broadly smoothed -> blended with the position where it is misleading -> normal
///
/// Rationale and measurements: docs/decisions/0017-surface-nets.md, and archive/0009 for the normal.
namespace palpate {

namespace internal {
struct SurfaceNet;
}

/// Largest distance that a surface's position can represent: the range of 16 bits in steps of
/// kSurfaceStep_mm.
inline constexpr double kMaxSurfaceReach_mm = 15;

/// Options of prepare_surfaces(). The defaults suit bones and thin tissue alike.
struct SurfaceOptions {
  /// Distance from the surface up to which the position is exact, mm, 1 ... kMaxSurfaceReach_mm; beyond, it
  /// is constant. Time and memory increase with it.
  double reach_mm = 4;
  /// Width of the filter that places the net's nodes before smoothing, mm, 0 ... 3. Has little influence: the
  /// smoothest net that keeps every voxel on its side is found from any start.
  double position_sigma_mm = 1;
  /// Width of the normal's Gaussian, mm, 0.5 ... 5. A larger width gives steadier normals on bone.
  double normal_sigma_mm = 2.35;
  /// Volume below which components (voxels that share a face, an edge or a corner) are reported as strays,
  /// mm3.
  double stray_below_mm3 = 20;
  /// Volume below which components are omitted, mm3. 0: keep all.
  double drop_below_mm3 = 0;
  int threads = 0;  ///< 0: one per processor; does not affect the result
};

/// A component of a structure that is small enough to be a segmentation error.
struct StrayComponent {
  std::size_t voxels = 0;
  double volume_mm3 = 0;
  VoxelBox box;             ///< In the label volume
  Point<Patient> centroid;  ///< Mean of its voxel centres
  bool dropped = false;     ///< Omitted from the surface
};

/// Intermediate data for updating part of a surface, besides its fields. In steps of kSurfaceStep_mm.
struct SurfaceIntermediates {
  VoxelBox extent;  ///< Bounding box of the structure's voxels at construction, in the label volume
  Bricks<std::int16_t> distance;  ///< To the nearest voxel centre of the other class, negative inside
  Bricks<std::int16_t> broad;     ///< Broadly smoothed distance, on the normal's grid
  /// Squared greatest slope of the position in every stretch of 32 cells along i; i fastest.
  std::vector<float> slopes;
  /// Net of the surface as first built, shared by later versions.
  std::shared_ptr<const internal::SurfaceNet> net;
};
/// Step of the distances stored in surfaces, mm.
inline constexpr double kSurfaceStep_mm = 1.0 / 2048;

/// A surface with the data to update it.
struct PreparedSurface {
  LabelId label = 0;
  Surface surface;
  SurfaceOptions options;
  double volume_mm3 = 0;               ///< Volume of the voxels, without dropped components
  int components = 0;                  ///< Number of components, including dropped ones
  std::vector<StrayComponent> strays;  ///< Smallest first
  /// Extent of the position in voxels of the label volume; larger than the structure, and may exceed the
  /// volume near its border.
  VoxelBox box;
  SurfaceIntermediates intermediates;
};

/// Surfaces of some structures of a label volume. Structures end at the volume's border; the axes of the grid
/// are assumed perpendicular. At every voxel centre the position's sign equals the label, so all labelled
/// centres are inside and the components (26-neighbourhood) are preserved. The normal has a grid of its own:
/// every n-th voxel where voxels are small, about 0.6 mm apart, since it contains no finer detail.
/// Bit-identical for any number of threads and SIMD target.
///
/// Errors: kBadInput for an option out of range, a label without voxels, label 0, or a structure too large
/// for memory; kInterrupted.
Result<std::vector<PreparedSurface>> prepare_surfaces(const Bricks<LabelId>& labels,
                                                      const std::vector<LabelId>& structures,
                                                      const SurfaceOptions& options,
                                                      const Progress& progress = {});

/// Variant of prepare_surfaces() that passes each surface to `visit` before building the next, for callers
/// that do not need the intermediate data.
Result<void> prepare_each_surface(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                  const SurfaceOptions& options,
                                  const std::function<void(PreparedSurface)>& visit,
                                  const Progress& progress = {});

/// Pairs of structures that touch: voxels that share a face, an edge or a corner. Errors: kInterrupted.
/// @param structures  without duplicates; none is 0
Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(const Bricks<LabelId>& labels,
                                                                const std::vector<LabelId>& structures,
                                                                int threads = 0,
                                                                const Progress& progress = {});
/// Connected groups of structures that touch, directly or through others. Groups are ordered by their first
/// structure, members in the order given; a structure that touches none is a group of its own. Structures
/// separated by a gap, however narrow, stay separate.
std::vector<std::vector<LabelId>> touching_groups(const std::vector<LabelId>& structures,
                                                  const std::vector<std::pair<LabelId, LabelId>>& touching);

/// Places where a structure is a sheet through which a point may slip.
struct Leaks {
  LabelId label = 0;
  std::size_t joints = 0;   ///< Places where the two sides meet at an edge or a corner of voxels
  Point<Patient> position;  ///< One of these places
};
/// Structures whose voxels are connected by edges or corners alone, so that free voxels on both sides meet
/// across an edge or corner: within two voxels of it neither side is connected to the other through faces,
/// and at most half of the voxels are touchable. The surface may be open there. Sides of fewer than 9 voxels
/// are pockets and do not count; neither do two structures that touch in this way, nor face-connected holes,
/// which are taken as intended by the segmentation. None are found within two voxels of the volume's border,
/// where structures end.
/// @param structures  all touchable structures: together they form the barrier to the tool
/// Errors: kInterrupted.
Result<std::vector<Leaks>> find_leaks(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                      int threads = 0, const Progress& progress = {});

/// One surface per group of structures, treating each group as one structure with the label of its first, so
/// that there is no crack between members. Errors: those of prepare_surfaces.
/// @param groups  disjoint
Result<std::vector<std::shared_ptr<const Surface>>> prepare_outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress = {});

/// Changes of a surface's fields, to be written over the old values. Steps of kSurfaceStep_mm.
struct SurfacePatch {
  /// False: the change cannot be expressed as a patch, because the structure grew beyond its original extent,
  /// has disappeared, or has small components to drop.
  bool is_applicable = false;
  long voxels_more = 0;  ///< Voxels that the structure gained; negative if tissue was removed
  PatchOf<std::int16_t> distance, position;  ///< Boxes in the position's grid
  PatchOf<std::int16_t> broad, normal;       ///< Boxes in the normal's grid
  PatchOf<float> slopes;                     ///< Box in stretches of cells
  double max_gradient = 1;                   ///< Greatest slope of the whole position
};

/// Update of a surface after its labels changed inside `dirty` only. Reads only labels near it. The
/// originally built net is carved and not smoothed again: where the eight voxel centres around a cell have
/// their original classes, the surface stays exactly in place; elsewhere it lies midway between the classes,
/// relaxed slightly towards its neighbourhood. The result is therefore bit-identical for any history of
/// changes leading to the same labels.
SurfacePatch prepare_patch(const PreparedSurface& old, const Bricks<LabelId>& labels, const VoxelBox& dirty);

/// Surface after its labels changed inside `dirty` only: prepare_patch() applied to the old one, sharing the
/// rest. Components and strays are not updated. If a patch is not possible, the whole surface is rebuilt as
/// by prepare_surfaces(). Errors: those of prepare_surfaces.
Result<PreparedSurface> update_surface(const PreparedSurface& old, const Bricks<LabelId>& labels,
                                       const VoxelBox& dirty);

}  // namespace palpate
