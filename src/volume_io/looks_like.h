#pragma once

#include <vector>

#include "palpate/volume_io/volume_io.h"

namespace palpate::volume_io {

/// Whether values are whole and in the range of labels, and, when asked for, few and in patches.
bool could_be_labels(const std::vector<float>& voxels, bool in_patches);

}  // namespace palpate::volume_io
