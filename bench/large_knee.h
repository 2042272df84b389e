#pragma once

#include <string>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

namespace palpate::bench {

/// A knee of 31 million voxels: the labels of `file`; if empty, knee_spl/seg.nrrd in a folder of
/// PALPATE_DATA; otherwise a generated knee of the same size. `what` receives a description.
Result<LabelMap> large_knee(const std::string& file, std::string& what);

}  // namespace palpate::bench
