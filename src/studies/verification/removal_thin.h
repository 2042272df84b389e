#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

struct ThinBone {
  bool all = true;     ///< False: two of the structures, on one grid at one rate
  double cut_s = 0.6;  ///< Duration of each run
};
/// Energy account of a burr in thin bone: energy that its motor spent on material compared with the cutting
/// energy of the voxel volume that disappeared, for walls, rods, a cellular and a trabecular pattern, upright
/// and tilted, at several tick rates and on several grids; with limits. Deterministic. Errors: kInterrupted.
Result<std::vector<Figure>> thin_bone_figures(const ThinBone& which, const Progress& progress);

}  // namespace palpate
