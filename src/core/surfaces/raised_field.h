#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "surfaces/surface_block.h"

namespace palpate::internal {

/// A field that starts at 0 and is raised slice by slice. Mostly uniform: tiles of a single value store no
/// voxels.
class RaisedField {
 public:
  explicit RaisedField(const GridGeometry& grid);

  /// Raises a slice to at least `values` in a box's rows and columns. Threads may raise different slices
  /// concurrently.
  /// @param values  values of the box's slice, i fastest
  void raise(int k, const Span3& box, const std::uint16_t* values);
  /// Moves the field to bricks, freeing tiles on the way so that both never exist completely.
  Bricks<std::uint16_t> take();

 private:
  static constexpr int kWidth = 64, kHeight = 16;
  struct Tile {
    std::uint16_t value = 0;  ///< Uniform value, if there are no voxels
    std::unique_ptr<std::array<std::uint16_t, std::size_t{kWidth} * kHeight>> voxels;
  };
  Tile& tile(int a, int b, int k) {
    return tiles_[static_cast<std::size_t>(a) +
                  static_cast<std::size_t>(across_) *
                      (static_cast<std::size_t>(b) +
                       static_cast<std::size_t>(down_) * static_cast<std::size_t>(k))];
  }

  GridGeometry grid_;
  int across_, down_;  ///< Number of tiles in a slice
  std::vector<Tile> tiles_;
};

}  // namespace palpate::internal
