#pragma once

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "palpate/volume_io.h"

namespace palpate::app {

/// Label maps are whole numbers, few of them, in patches: most neighbours along i that are both not
/// background are equal. An 8-bit scan has few values too, but they change from voxel to voxel.
/// @param named  a table of names is at hand, so whole numbers are enough
inline bool looks_like_labels(const ScanFile& file, bool named) {
  const bool integer = file.header.component_type.find("int") != std::string::npos;
  const std::vector<float>& voxels = file.scan.voxels();
  const auto [low, high] = std::minmax_element(voxels.begin(), voxels.end());
  constexpr float kHighestLabel = 4096;
  if (!integer || *low < 0 || *high > kHighestLabel) return false;
  if (named) return true;

  std::vector<bool> seen(static_cast<std::size_t>(kHighestLabel) + 1);
  std::size_t distinct = 0, equal = 0, unequal = 0;
  for (std::size_t n = 0; n < voxels.size(); ++n) {
    if (voxels[n] != std::floor(voxels[n])) return false;
    const auto value = static_cast<std::size_t>(voxels[n]);
    distinct += !seen[value];
    seen[value] = true;
    if (n > 0 && voxels[n] != 0 && voxels[n - 1] != 0) ++(voxels[n] == voxels[n - 1] ? equal : unequal);
  }
  return distinct <= 256 && equal >= unequal;
}

}  // namespace palpate::app
