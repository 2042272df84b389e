#pragma once

#include <string>

#include "palpate/volume/volume.h"

namespace palpate::bench {

/// A knee of 31 million voxels: the labels of that file; without one knee_spl/seg.nrrd in a folder of
/// PALPATE_DATA; without that a generated knee of as many voxels. `what` says which.
Result<LabelMap> large_knee(const std::string& file, std::string& what);

}  // namespace palpate::bench
