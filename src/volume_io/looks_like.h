#pragma once

#include <string>
#include <vector>

#include "palpate/volume_io/volume_io.h"

/// Tells label maps from scans by their values.
namespace palpate::volume_io {

/// Counts over the voxels of a volume.
struct ValueStatistics {
  bool only_whole = true;    ///< every value is a whole number in 0 ... 65535; where not, all else is 0
  std::size_t distinct = 0;  ///< number of values besides 0
  /// Pairs of neighbours along i that are both not 0, by whether their values are equal, and those of the
  /// unequal ones whose values differ by 2 at most.
  std::size_t equal = 0, unequal = 0, near = 0;
  double median_run = 0;              ///< voxels; median over the values of their mean run length along i
  std::vector<char> is_present = {};  ///< by value
};
ValueStatistics statistics_of(const std::vector<float>& voxels);

struct VolumeContent {
  enum class Kind { kScan, kLabels, kUnclear };
  Kind kind = Kind::kUnclear;
  std::string evidence;  ///< "its 3 values lie in patches"
};
VolumeContent content_by_values(const ValueStatistics& statistics);

/// Whether values are whole and not negative, some of them above 65535, and in patches: ids of a label map
/// that are too large for it.
bool has_large_ids(const std::vector<float>& voxels);

}  // namespace palpate::volume_io
