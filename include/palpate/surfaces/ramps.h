#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/volume.h"

/// Ramps that do not grow what they are made of: the field of the direct force methods that is exactly 0 at
/// every voxel centre outside all felt structures and rises inside with the depth from free space.
///
///     labels in S -> signed distance -> smoothed, every voxel kept on its side -> depth d(S)
///
///     v(x) = greatest over chains S_0, S_1, ... S_n of structures, each resting on the one before and
///            touching it, x in one of them, of
///            sum over m of (K_m - K_(m+1)) d(S_0 + ... + S_m)(x)         K_(n+1) = 0
///
/// For a structure alone that is K d: what touches it is free space to it. For bone under cartilage it is
/// K_cartilage d(both) + (K_bone - K_cartilage) d(bone): continuous at their border, K of the one above and
/// of the other below. It never exceeds the least over paths from free space of the integral of K, and is
/// that where the nearest places outside the parts lie on one line. Why so, and what was measured:
/// docs/decisions/0011-inward-ramps.md.
namespace palpate {

struct RampStructure {
  LabelId label = 0;
  double stiffness_N_per_mm = 1;
  /// All structures that support it, directly or through others; each at least as stiff. Which of them it
  /// touches the labels show.
  std::vector<LabelId> rests_on;
};

struct RampOptions {
  /// N/mm, of the scene's stiffest tissue, which need not be among the structures. At least theirs; 0:
  /// theirs.
  double stiffest_N_per_mm = 0;
  /// mm, kLeastRampWidth_mm ... kMostRampWidth_mm. Depth at which the stiffest tissue gives its full force,
  /// K_greatest * width_mm.
  double width_mm = 4;
  int threads = 0;  ///< 0: as many as the machine has; results do not depend on it
};
/// Chains of structures resting on each other that are looked at.
inline constexpr int kMostRampChains = 2000;
inline constexpr double kLeastRampWidth_mm = 1, kMostRampWidth_mm = 12;
/// Softer structures go on rising below the width, as far as this.
inline constexpr double kDeepestRamp_mm = 12;

/// What a structure can give.
struct RampFigures {
  LabelId label = 0;
  double most_N = 0;  ///< greatest v of its voxels
  /// mm. Median over the structure's own ridge (voxels that no neighbour lies deeper than) of the distance to
  /// the nearest voxel centre outside; up to half a voxel more than half the thickness, and no more than 7.
  double half_thickness_mm = 0;
};

struct Ramps {
  Bricks<std::uint16_t> field;          ///< v / full_force_N of 65535; 0 outside, at least 1 inside
  double full_force_N = 0;              ///< K_greatest * width
  std::vector<RampFigures> structures;  ///< in the order given, those that have voxels
};

/// Structures end where the volume does; the axes of the grid count as perpendicular. The same bit for bit
/// with any number of threads and SIMD target.
///
/// Errors: kBadInput for an option out of range, a stiffness that is not positive, the label 0, a support
/// that is none of the structures, softer than what rests on it or rests on it in turn, more than
/// kMostRampChains chains, too little memory; kInterrupted.
Result<Ramps> prepare_ramps(const Bricks<LabelId>& labels, const std::vector<RampStructure>& structures,
                            const RampOptions& options, const Progress& progress = {});

/// The width of an inward ramp on a grid, mm: the one asked for; else two of the grid's widest voxels, at
/// least kUsualRampWidth_mm and at most kMostRampWidth_mm. On voxels of more than half of that the force of
/// the direct methods shows the slices. Error kBadInput where a width is asked for that is less than two
/// voxels.
Result<double> ramp_width_mm(std::optional<double> asked_mm, const GridGeometry& grid);
inline constexpr double kUsualRampWidth_mm = 4;

/// The same in 8 bits: 0 stays 0, and what was above 0 is at least 1.
Bricks<std::uint8_t> in_eight_bits(const Bricks<std::uint16_t>& ramp);

}  // namespace palpate
