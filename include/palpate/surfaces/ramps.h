#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Inward ramps: the field of the direct force methods that does not enlarge structures. It is exactly 0 at
/// every voxel centre outside all touchable structures and rises inside with the depth below free space.
///
///     labels in S -> signed distance -> smoothed, every voxel keeping its sign -> depth d(S)
///
///     v(x) = maximum over chains S_0, S_1, ... S_n of structures, each resting on the one before and
///            touching it, x in one of them, of
///            sum over m of (K_m - K_(m+1)) d(S_0 + ... + S_m)(x)         K_(n+1) = 0
///
/// For a single structure this is K d; structures that touch it count as free space. For bone under cartilage
/// it is K_cartilage d(both) + (K_bone - K_cartilage) d(bone): continuous at their interface, with slope K of
/// the upper structure above and K of the lower one below it. It never exceeds the minimum over paths from
/// free space of the integral of K, and equals it where the nearest points outside the unions lie on one
/// line. Rationale and measurements: docs/decisions/archive/0011-inward-ramps.md.
namespace palpate {

/// Structure to include in the ramps.
struct RampStructure {
  LabelId label = 0;
  double stiffness_N_per_mm = 1;
  /// All structures that support it, directly or through others; each at least as stiff. Contact between them
  /// follows from the labels.
  std::vector<LabelId> rests_on;
};

/// Options of prepare_ramps().
struct RampOptions {
  /// Stiffness of the scene's stiffest tissue, N/mm, which need not be among the structures. At least theirs;
  /// 0: the greatest of theirs.
  double stiffest_N_per_mm = 0;
  /// Depth at which the stiffest tissue reaches the full force K_greatest * width_mm, mm; kMinRampWidth_mm
  /// ... kMaxRampWidth_mm.
  double width_mm = 4;
  int threads = 0;  ///< 0: one per processor; does not affect the result
};
/// Maximum number of chains of structures resting on each other.
inline constexpr int kMaxRampChains = 2000;
/// Range of the width of a ramp, mm.
inline constexpr double kMinRampWidth_mm = 1, kMaxRampWidth_mm = 12;
/// Depth, mm, to which the ramps of softer structures continue below the width.
inline constexpr double kDeepestRamp_mm = 12;

/// Properties of a structure's ramp.
struct RampStatistics {
  LabelId label = 0;
  double max_N = 0;  ///< Maximum of the ramp v over the structure's voxels
  /// Half thickness, mm: median distance to the nearest voxel centre outside over the structure's own ridge
  /// (voxels with no deeper neighbour). Up to half a voxel more than half the true thickness, and at most 7.
  double half_thickness_mm = 0;
};

/// Result of prepare_ramps().
struct Ramps {
  Bricks<std::uint16_t> field;  ///< Field v / full_force_N, scaled to 65535; 0 outside, at least 1 inside
  double full_force_N = 0;      ///< K_greatest * width
  std::vector<RampStatistics> structures;  ///< In the order given, without structures that have no voxels
};

/// Computes inward ramps. Structures end at the volume's border; the axes of the grid are assumed
/// perpendicular. Bit-identical for any number of threads and SIMD target.
///
/// Errors: kBadInput for an option out of range, a stiffness that is not positive, label 0, a support that is
/// not among the structures, is softer than what rests on it, or rests on it in turn, more than
/// kMaxRampChains chains, or insufficient memory; kInterrupted.
Result<Ramps> prepare_ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                            const RampOptions& options, const Progress& progress = {});

/// Width of an inward ramp on a grid, mm: the requested one, or twice the grid's largest voxel spacing within
/// kUsualRampWidth_mm ... kMaxRampWidth_mm. If the spacing exceeds half of that maximum, the force of the
/// direct methods reveals the slices. Error kBadInput if a width below two voxels is requested.
Result<double> ramp_width_mm(std::optional<double> requested_mm, const GridGeometry& grid);
inline constexpr double kUsualRampWidth_mm = 4;

/// The same ramps in 8 bits: 0 stays 0, and values above 0 stay at least 1.
Bricks<std::uint8_t> in_eight_bits(const Bricks<std::uint16_t>& ramp);

}  // namespace palpate
