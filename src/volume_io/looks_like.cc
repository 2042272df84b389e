#include <algorithm>
#include <cmath>

#include "palpate/base/for_each_index.h"
#include "volume_io/looks_like.h"

namespace palpate {

using namespace volume_io;

namespace {

// Neighbours along i that are both not background, by whether they are equal: in patches most are, in a scan
// few. And those that are next to equal: in a smooth scan most of the unequal ones, in patches hardly any.
struct Neighbours {
  std::size_t equal = 0, unequal = 0, near = 0;

  void add(const Neighbours& more) {
    equal += more.equal;
    unequal += more.unequal;
    near += more.near;
  }
  /// Each of these voxels with the one before it.
  template <class T>
  void see(const std::vector<T>& voxels, std::size_t begin, std::size_t end) {
    for (std::size_t n = std::max<std::size_t>(begin, 1); n < end; ++n)
      if (voxels[n] != 0 && voxels[n - 1] != 0) {
        ++(voxels[n] == voxels[n - 1] ? equal : unequal);
        near += voxels[n] != voxels[n - 1] && std::abs(voxels[n] - voxels[n - 1]) <= 2;
      }
  }
};

constexpr float kHighestLabel = 4096;

/// What a thread has seen of a volume.
struct LabelsSeen {
  std::vector<char> label = std::vector<char>(static_cast<std::size_t>(kHighestLabel) + 1);
  Neighbours neighbours;

  /// False where one of these voxels is no label.
  bool see(const std::vector<float>& voxels, std::size_t begin, std::size_t end) {
    for (std::size_t n = begin; n < end; ++n) {
      // first, so that the conversion is defined
      if (!(voxels[n] >= 0 && voxels[n] <= kHighestLabel)) return false;
      const int whole = static_cast<int>(voxels[n]);
      if (static_cast<float>(whole) != voxels[n]) return false;
      label[static_cast<std::size_t>(whole)] = 1;
    }
    return true;
  }
};

}  // namespace

namespace volume_io {

bool could_be_labels(const std::vector<float>& voxels, bool in_patches) {
  constexpr std::ptrdiff_t kMostLabels = 256;
  constexpr std::size_t kPiece = std::size_t{1} << 20;
  const auto pieces = static_cast<int>((voxels.size() + kPiece - 1) / kPiece);
  const int workers = worker_count(0, pieces);
  std::vector<LabelsSeen> of_worker(static_cast<std::size_t>(workers));
  const bool are_labels = for_each_index(pieces, workers, [&](int worker, int index) {
    LabelsSeen& seen = of_worker[static_cast<std::size_t>(worker)];
    const std::size_t begin = static_cast<std::size_t>(index) * kPiece;
    const std::size_t end = std::min(voxels.size(), begin + kPiece);
    if (!seen.see(voxels, begin, end)) return false;
    if (in_patches) seen.neighbours.see(voxels, begin, end);
    return true;
  });
  if (!are_labels) return false;
  LabelsSeen& all = of_worker.front();
  for (std::size_t w = 1; w < of_worker.size(); ++w) {
    for (std::size_t label = 0; label < all.label.size(); ++label)
      all.label[label] |= of_worker[w].label[label];
    all.neighbours.add(of_worker[w].neighbours);
  }
  const auto distinct = std::count(all.label.begin(), all.label.end(), 1);
  // of background alone nothing is a label
  if (distinct == all.label.front()) return false;
  return !in_patches || (distinct <= kMostLabels && all.neighbours.equal >= all.neighbours.unequal);
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
  for (const Volume<LabelId>& layer : labels.layers) neighbours.see(layer.voxels(), 0, layer.voxels().size());
  const bool smooth = 2 * neighbours.near > neighbours.unequal;
  return neighbours.unequal > neighbours.equal || (smooth && 2 * neighbours.unequal > neighbours.equal);
}

}  // namespace palpate
