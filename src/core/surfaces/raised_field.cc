#include "surfaces/raised_field.h"

#include <algorithm>

namespace palpate::internal {

RaisedField::RaisedField(const GridGeometry& grid)
    : grid_(grid),
      across_((grid.dims[0] + kWidth - 1) / kWidth),
      down_((grid.dims[1] + kHeight - 1) / kHeight),
      tiles_(static_cast<std::size_t>(across_) * static_cast<std::size_t>(down_) *
             static_cast<std::size_t>(grid.dims[2])) {}

void RaisedField::raise(int k, const Span3& box, const std::uint16_t* values) {
  if (box.size(0) <= 0 || box.size(1) <= 0) return;
  std::array<std::uint16_t, std::size_t{kWidth} * kHeight> voxels;
  for (int b = box.low[1] / kHeight; b <= (box.high[1] - 1) / kHeight; ++b) {
    for (int a = box.low[0] / kWidth; a <= (box.high[0] - 1) / kWidth; ++a) {
      const int i0 = a * kWidth, j0 = b * kHeight;
      const int width = std::min(kWidth, grid_.dims[0] - i0), height = std::min(kHeight, grid_.dims[1] - j0);
      const int low = std::max(box.low[0], i0), high = std::min(box.high[0], i0 + width);
      const int top = std::max(box.low[1], j0), bottom = std::min(box.high[1], j0 + height);
      Tile& here = tile(a, b, k);
      if (here.voxels)
        voxels = *here.voxels;
      else
        voxels.fill(here.value);
      bool raised = false;
      for (int j = top; j < bottom; ++j) {
        const std::uint16_t* from =
            values + static_cast<std::ptrdiff_t>(j - box.low[1]) * box.size(0) + (low - box.low[0]);
        std::uint16_t* to = voxels.data() + (j - j0) * kWidth + (low - i0);
        for (int i = 0; i < high - low; ++i) {
          raised = raised || from[i] > to[i];
          to[i] = std::max(to[i], from[i]);
        }
      }
      if (!raised) continue;
      bool one_value = true;
      for (int j = 0; j < height && one_value; ++j) {
        const std::uint16_t* row = voxels.data() + j * kWidth;
        one_value = std::all_of(row, row + width, [&](std::uint16_t v) { return v == voxels[0]; });
      }
      if (one_value) {
        here.value = voxels[0];
        here.voxels.reset();
      } else if (here.voxels) {
        *here.voxels = voxels;
      } else {
        here.voxels = std::make_unique<std::array<std::uint16_t, std::size_t{kWidth} * kHeight>>(voxels);
      }
    }
  }
}

Bricks<std::uint16_t> RaisedField::take() {
  BricksBuilder<std::uint16_t> bricks(grid_, 0);
  const int row = grid_.dims[0];
  std::vector<std::uint16_t> slice(static_cast<std::size_t>(row) * static_cast<std::size_t>(grid_.dims[1]));
  for (int k = 0; k < grid_.dims[2]; ++k) {
    for (int b = 0; b < down_; ++b) {
      for (int a = 0; a < across_; ++a) {
        Tile& here = tile(a, b, k);
        const int i0 = a * kWidth, width = std::min(kWidth, row - i0);
        for (int j = b * kHeight; j < std::min(grid_.dims[1], (b + 1) * kHeight); ++j) {
          std::uint16_t* to = slice.data() + static_cast<std::ptrdiff_t>(j) * row + i0;
          if (here.voxels)
            std::copy_n(here.voxels->data() + (j - b * kHeight) * kWidth, width, to);
          else
            std::fill_n(to, width, here.value);
        }
        here.voxels.reset();
      }
    }
    bricks.add(1, slice.data());
  }
  return bricks.take();
}

}  // namespace palpate::internal
