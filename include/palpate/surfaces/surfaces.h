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

/// From labels to surfaces that contact can lean on, and the same again where tissue was removed.
///
///     labels == id -> signed distance -> filtered -> a net between the voxels, smooth as they allow
///                                                                  |
///     position: the distance to the net <--------------------------+
///         +-> broadly smoothed -> where that goes astray, gives way to the position -> normal
///
/// Why so, and what was measured: docs/decisions/0017-surface-nets.md, and 0009 for the normal.
namespace palpate {

namespace internal {
struct SurfaceNet;
}

/// The largest distance of a surface's position: what 16 bits hold in steps of kSurfaceStep_mm.
inline constexpr double kMostSurfaceReach_mm = 15;

/// One setting serves bones and thin tissue alike; what each number moves is said beside it.
struct SurfaceOptions {
  /// mm, 1 ... kMostSurfaceReach_mm. How far from the surface the position still grows; beyond, it stays at
  /// that. The work and the memory grow with it.
  double reach_mm = 4;
  /// mm, 0 ... 3. Width of the filter by which the net's nodes are placed before it is made smooth. It
  /// decides little: what is smooth and keeps every voxel on its side is found from anywhere.
  double position_sigma_mm = 1;
  /// mm, 0.5 ... 5. Width of the Gaussian of the normal. Wider is steadier on bone.
  double normal_sigma_mm = 2.35;
  /// mm3. Components (voxels that share a face, an edge or a corner) below it are reported as strays.
  double stray_below_mm3 = 20;
  /// mm3. Components below it are left out. 0 keeps all.
  double drop_below_mm3 = 0;
  int threads = 0;  ///< 0: as many as the machine has; results do not depend on it
};

/// A component of a structure that is so small that it is probably a slip of the pen.
struct StrayComponent {
  std::size_t voxels = 0;
  double volume_mm3 = 0;
  VoxelBox box;             ///< in the label volume
  Point<Patient> centroid;  ///< mean of voxel centres
  bool dropped = false;     ///< it is no part of the surface
};

/// What preparing a part of a structure again needs besides its fields. In steps of kSurfaceStep_mm.
struct SurfaceWorkings {
  VoxelBox extent;                ///< the structure's own voxels when it was made, in the label volume
  Bricks<std::int16_t> distance;  ///< to the nearest voxel centre of the other class, negative inside
  Bricks<std::int16_t> broad;     ///< the broadly smoothed distance, on the normal's grid
  /// Squares of the position's greatest slope in every stretch of 32 cells along i; i fastest.
  std::vector<float> slopes;
  /// The surface as it was made once, which later versions share.
  std::shared_ptr<const internal::SurfaceNet> net;
};
inline constexpr double kSurfaceStep_mm = 1.0 / 2048;

struct PreparedSurface {
  LabelId label = 0;
  Surface surface;
  SurfaceOptions options;
  double volume_mm3 = 0;               ///< of the voxels that count; dropped ones do not
  int components = 0;                  ///< of the structure, dropped ones included
  std::vector<StrayComponent> strays;  ///< smallest first
  /// What the position covers, in voxels of the label volume; wider than the structure, and than the
  /// volume where the structure comes near its border.
  VoxelBox box;
  SurfaceWorkings workings;
};

/// Surfaces of some structures of one label volume. A structure ends where the volume does; the axes of the
/// grid count as perpendicular. At the centre of every voxel of the grid the position's sign is the label, so
/// that all labelled centres are inside and components (26 neighbours) stay as they are. The normal has a
/// grid of its own, of every n-th voxel where voxels are small, about 0.6 mm apart: it holds nothing finer.
/// The result is the same bit for bit with any number of threads and SIMD target.
///
/// Errors: kBadInput for an option out of range, a label without voxels, the label 0, a structure too large
/// for memory; kInterrupted.
Result<std::vector<PreparedSurface>> prepare_surfaces(const Bricks<LabelId>& labels,
                                                      const std::vector<LabelId>& structures,
                                                      const SurfaceOptions& options,
                                                      const Progress& progress = {});

/// The same, one after the other: each is handed over before the next is made, for who does not keep what
/// they were made of.
Result<void> prepare_each_surface(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                  const SurfaceOptions& options,
                                  const std::function<void(PreparedSurface)>& take,
                                  const Progress& progress = {});

/// Pairs of structures that touch: voxels that share a face, an edge or a corner. Errors: kInterrupted.
/// @param structures  without repetition; none is 0
Result<std::vector<std::pair<LabelId, LabelId>>> touching_pairs(const Bricks<LabelId>& labels,
                                                                const std::vector<LabelId>& structures,
                                                                int threads = 0,
                                                                const Progress& progress = {});
/// Structures that touch, directly or through others of them. Groups in the order of their first structures,
/// each in the order given; one that touches nobody is a group of its own. What does not touch stays apart,
/// however narrow the gap.
std::vector<std::vector<LabelId>> touching_groups(const std::vector<LabelId>& structures,
                                                  const std::vector<std::pair<LabelId, LabelId>>& touching);

/// Where a structure is a sheet through which a point may slip.
struct Leaks {
  LabelId label = 0;
  std::size_t joints = 0;  ///< places where the two sides meet at an edge or a corner of voxels
  Point<Patient> place;    ///< one of them
};
/// Structures whose voxels hold together by edges or corners alone, so that free voxels of both sides meet
/// across an edge or a corner: within two voxels of it neither side reaches the other through faces, and at
/// most half of them are felt. The surface may be open there. Sides of fewer than 9 voxels are pockets and do
/// not count; nor do two structures that touch so, nor a hole of voxels that share faces, which is as it was
/// drawn. Nearer than two voxels to the volume's border none are found: structures end there.
/// @param structures  what is felt: together they are what keeps the tool out
/// Errors: kInterrupted.
Result<std::vector<Leaks>> find_leaks(const Bricks<LabelId>& labels, const std::vector<LabelId>& structures,
                                      int threads = 0, const Progress& progress = {});

/// One surface for each of some groups of structures, as if a group were one structure with the label of its
/// first: it has no crack where two of them meet. Errors: those of prepare_surfaces.
/// @param groups  no structure is in two of them
Result<std::vector<std::shared_ptr<const Surface>>> prepare_outer_surfaces(
    const Bricks<LabelId>& labels, const std::vector<std::vector<LabelId>>& groups,
    const SurfaceOptions& options, const Progress& progress = {});

/// What changes of a surface, to be written over the old values. Steps of kSurfaceStep_mm.
struct SurfacePatch {
  /// False: a patch does not do. The structure grew beyond what it was, is gone, or small components are
  /// dropped.
  bool local = false;
  long voxels_more = 0;                      ///< that the structure gained; negative where tissue was removed
  PatchOf<std::int16_t> distance, position;  ///< boxes in the position's grid
  PatchOf<std::int16_t> broad, normal;       ///< boxes in the normal's grid
  PatchOf<float> slopes;                     ///< box in stretches of cells
  double steepest = 1;                       ///< of the whole position
};

/// What follows for a surface from labels that changed inside `dirty` and nowhere else. Reads the labels
/// near it alone. The surface as it was made once is carved and not smoothed anew: where the eight voxel
/// centres around a place are as they were, the surface stays exactly where it was made; elsewhere it goes
/// midway between the classes, drawn a little towards what is beside it. So it is the same bit for bit
/// however the labels came to be what they are.
SurfacePatch prepare_patch(const PreparedSurface& old, const Bricks<LabelId>& labels, const VoxelBox& dirty);

/// A surface after its labels changed inside `dirty` and nowhere else: the patch, and the rest shared with
/// the old one. Components and strays are not looked for again. Where a patch does not do, the whole surface
/// is made anew, as prepare_surfaces makes it. Errors: those of prepare_surfaces.
Result<PreparedSurface> prepare_surface_again(const PreparedSurface& old, const Bricks<LabelId>& labels,
                                              const VoxelBox& dirty);

}  // namespace palpate
