#pragma once

#include <string>
#include <vector>

#include "palpate/volume_io/volume_io.h"

/// Distinguishes label maps from scans by their values.
namespace palpate::volume_io {

/// Statistics of a volume's values.
struct ValueStatistics {
  bool only_whole = true;    ///< All values are integers in 0 ... 65535; if false, all other members are 0.
  std::size_t distinct = 0;  ///< Number of distinct non-zero values.
  /// Pairs of neighbours along i that are both non-zero: with equal values, with unequal values, and with
  /// unequal values that differ by at most 2.
  std::size_t equal = 0, unequal = 0, near = 0;
  double median_run = 0;              ///< Median over the distinct values of their mean run length along i;
                                      ///< voxels.
  std::vector<char> is_present = {};  ///< Indexed by value.
};
ValueStatistics statistics_of(const std::vector<float>& voxels);

struct VolumeContent {
  enum class Kind { kScan, kLabels, kUnclear };
  Kind kind = Kind::kUnclear;
  std::string evidence;  ///< Reason for the user: "its 3 values lie in patches".
};
VolumeContent content_by_values(const ValueStatistics& statistics);

/// True if values are non-negative integers in contiguous patches, some of them above 65535: a label map with
/// ids that are too large.
bool has_large_ids(const std::vector<float>& voxels);

}  // namespace palpate::volume_io
