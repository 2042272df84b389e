#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/verification/verification.h"

namespace palpate {

struct LedVolumes {
  bool all = true;  ///< false: two of the ways, at two rates, on one grid
};
/// What burrs take out of a block of exact distances whose tips are led on given ways, beside the volume that
/// geometry says: of a ball a groove and a plane milled in passes, of cylinders and cones ways along the axis
/// and across it. Measured on the carved surface and as RemovedVolume counts it, at several rates of ticks
/// and on several grids; with limits. The same in every run. Errors: kInterrupted.
Result<std::vector<Figure>> led_volumes_figures(const LedVolumes& which, const Progress& progress);

}  // namespace palpate
