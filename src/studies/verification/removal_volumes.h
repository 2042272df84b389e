#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

struct PathVolumeOptions {
  bool all = true;  ///< False: only two of the paths, at two rates, on one grid
};
/// Volumes removed by burrs whose tips follow prescribed paths through a block of exact distances, compared
/// with the geometric volume: for a ball a groove and a plane milled in passes, for cylinders and cones paths
/// along the axis and across it. Measured on the carved surface and by RemovedVolume, at several tick rates
/// and on several grids; with limits. Deterministic. Errors: kInterrupted.
Result<std::vector<Figure>> path_volume_figures(const PathVolumeOptions& options, const Progress& progress);

}  // namespace palpate
