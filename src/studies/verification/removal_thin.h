#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

struct ThinBoneOptions {
  bool all = true;     ///< False: two of the structures, on one grid at one rate
  double cut_s = 0.6;  ///< Duration of each run
};
/// Energy account of a burr in thin bone: energy that its motor spent on material compared with the cutting
/// energy of the voxel volume that disappeared, for walls, rods, a cellular and a trabecular pattern, upright
/// and tilted, at several tick rates and on several grids; with limits. Deterministic. Errors: kInterrupted.
Result<std::vector<Figure>> thin_bone_figures(const ThinBoneOptions& options, const Progress& progress);

/// Longest time in which a running burr of 4 mm stands still, although it is pressed with 1.5 N, while it is
/// led through a cellular pattern to random points and back through what it has cut.
/// @param voxel_mm  voxel size
Result<double> longest_rest_s(double voxel_mm, unsigned seed, double seconds);

}  // namespace palpate
