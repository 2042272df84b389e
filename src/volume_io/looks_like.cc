#include <algorithm>
#include <cmath>

#include "volume_io/looks_like.h"

namespace palpate {

using namespace volume_io;

namespace {

// Neighbours along i that are both not background, by whether they are equal: in patches most are, in a scan
// few. And those that are next to equal: in a smooth scan most of the unequal ones, in patches hardly any.
struct Neighbours {
  std::size_t equal = 0, unequal = 0, near = 0;

  template <class T>
  void see(const std::vector<T>& voxels) {
    for (std::size_t n = 1; n < voxels.size(); ++n)
      if (voxels[n] != 0 && voxels[n - 1] != 0) {
        ++(voxels[n] == voxels[n - 1] ? equal : unequal);
        near += voxels[n] != voxels[n - 1] && std::abs(voxels[n] - voxels[n - 1]) <= 2;
      }
  }
};

}  // namespace

namespace volume_io {

bool could_be_labels(const std::vector<float>& voxels, bool in_patches) {
  constexpr float kHighestLabel = 4096;
  constexpr std::size_t kMostLabels = 256;
  const auto [low, high] = std::minmax_element(voxels.begin(), voxels.end());
  if (*low < 0 || *high > kHighestLabel || *high == 0) return false;
  std::vector<bool> seen(static_cast<std::size_t>(kHighestLabel) + 1);
  std::size_t distinct = 0;
  for (const float value : voxels) {
    if (value != std::floor(value)) return false;
    const auto label = static_cast<std::size_t>(value);
    distinct += !seen[label];
    seen[label] = true;
  }
  if (!in_patches) return true;
  Neighbours neighbours;
  neighbours.see(voxels);
  return distinct <= kMostLabels && neighbours.equal >= neighbours.unequal;
}

}  // namespace volume_io

bool looks_like_labels(const ScanFile& file) {
  if (file.header.has_segments || file.header.meaning == ValueMeaning::kLabels) return true;
  return file.header.meaning == ValueMeaning::kUnsaid && could_be_labels(file.scan.voxels(), true);
}

bool looks_like_scan(const LabelMap& labels) {
  constexpr std::size_t kManyLabels = 64;
  if (labels.segments.size() <= kManyLabels) return false;
  Neighbours neighbours;
  for (const Volume<LabelId>& layer : labels.layers) neighbours.see(layer.voxels());
  const bool smooth = 2 * neighbours.near > neighbours.unequal;
  return neighbours.unequal > neighbours.equal || (smooth && 2 * neighbours.unequal > neighbours.equal);
}

}  // namespace palpate
