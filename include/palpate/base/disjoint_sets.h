#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace palpate {

/// Disjoint sets of numbered elements; the root of a set is its smallest element. Array-based union-find with
/// path compression (Wu, Otoo, Suzuki, Two strategies to speed up connected component labeling algorithms,
/// 2005).
class DisjointSets {
 public:
  /// Adds a set with one new element and returns the element; elements are numbered from 0.
  std::uint32_t add() {
    parent_.push_back(static_cast<std::uint32_t>(parent_.size()));
    return parent_.back();
  }
  std::uint32_t root(std::uint32_t n) {
    while (parent_[n] != n) n = parent_[n] = parent_[parent_[n]];
    return n;
  }
  void join(std::uint32_t a, std::uint32_t b) {
    a = root(a);
    b = root(b);
    parent_[std::max(a, b)] = std::min(a, b);
  }
  std::size_t size() const { return parent_.size(); }

 private:
  std::vector<std::uint32_t> parent_;
};

}  // namespace palpate
