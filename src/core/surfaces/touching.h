#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/volume/bricks.h"
#include "palpate/volume/slices.h"
#include "palpate/volume/volume.h"

namespace palpate::internal {

/// Symmetric relation of structures that touch.
class Touching {
 public:
  explicit Touching(std::size_t structures) : count_(structures), pairs_(structures * structures, 0) {}
  void add(int a, int b) {
    if (a >= 0 && b >= 0) pairs_[static_cast<std::size_t>(a) * count_ + static_cast<std::size_t>(b)] = 1;
  }
  void add(const Touching& other) {
    for (std::size_t n = 0; n < pairs_.size(); ++n) pairs_[n] |= other.pairs_[n];
  }
  bool operator()(std::size_t a, std::size_t b) const {
    return pairs_[a * count_ + b] != 0 || pairs_[b * count_ + a] != 0;
  }

 private:
  std::size_t count_;
  std::vector<char> pairs_;
};

/// Kind of contact between voxels that counts as touching.
enum class Adjacency { kFace, kFaceEdgeOrCorner };

/// Finds pairs of structures whose voxels touch.
/// @param index  structure of every label, 0 ... structures - 1; -1: none
/// Errors: kInterrupted.
Result<Touching> find_touching(const Bricks<LabelId>& labels, const std::vector<int>& index,
                               std::size_t structures, Adjacency adjacency, int threads,
                               const Progress& progress, const ProgressSpan& stage);

}  // namespace palpate::internal
