#include "c/label_slices.h"

#include <cstddef>
#include <cstring>
#include <limits>
#include <string>
#include <utility>

#include "palpate/volume/grid.h"

namespace palpate::c {
namespace {

GridGeometry grid_of(const plp_labels& labels) {
  GridGeometry grid;
  for (int axis = 0; axis < 3; ++axis) {
    grid.dims[static_cast<std::size_t>(axis)] = labels.dims[axis];
    grid.spacing_mm[axis] = labels.spacing_mm[axis];
    grid.origin[axis] = labels.origin_mm[axis];
    for (int column = 0; column < 3; ++column)
      grid.direction(axis, column) = labels.direction[3 * axis + column];
  }
  return grid;
}

std::size_t bytes_of(std::int32_t type) {
  switch (type) {
    case PLP_UINT8:
    case PLP_INT8:
      return 1;
    case PLP_UINT16:
    case PLP_INT16:
      return 2;
    case PLP_UINT32:
    case PLP_INT32:
      return 4;
    case PLP_UINT64:
    case PLP_INT64:
      return 8;
    default:
      return 0;
  }
}

// reads the slices of a volume of T
template <class T>
class SliceReader {
 public:
  SliceReader(const plp_labels& labels, const std::array<std::ptrdiff_t, 3>& strides)
      : labels_(labels), strides_(strides) {}

  // false if a value is no label
  bool read(int k, std::vector<LabelId>& slice, std::vector<bool>& present) const {
    const auto* voxels = static_cast<const std::byte*>(labels_.voxels) + k * strides_[2];
    std::size_t n = 0;
    LabelId last = 0;
    for (int j = 0; j < labels_.dims[1]; ++j)
      for (int i = 0; i < labels_.dims[0]; ++i, ++n) {
        T value;
        std::memcpy(&value, voxels + j * strides_[1] + i * strides_[0], sizeof value);
        if (!std::in_range<LabelId>(value)) return false;
        slice[n] = static_cast<LabelId>(value);
        if (slice[n] == last) continue;
        last = slice[n];
        present[last] = true;
      }
    return true;
  }

 private:
  const plp_labels& labels_;
  std::array<std::ptrdiff_t, 3> strides_;
};

template <class T>
Result<LabelBricks> read_slices(const plp_labels& labels, const GridGeometry& grid,
                                const std::array<std::ptrdiff_t, 3>& strides) {
  const SliceReader<T> reader(labels, strides);
  std::vector<LabelId> slice(static_cast<std::size_t>(grid.dims[0]) * static_cast<std::size_t>(grid.dims[1]));
  LabelBricks read;
  read.present.assign(std::numeric_limits<LabelId>::max() + std::size_t{1}, false);
  BricksBuilder<LabelId> bricks(grid, 0);
  for (int k = 0; k < grid.dims[2]; ++k) {
    if (!reader.read(k, slice, read.present))
      return Error{ErrorKind::kBadInput, "slice " + std::to_string(k) + " has a value that is no label",
                   "labels", "labels are 0 (background) to 65535"};
    bricks.add(1, slice.data());
  }
  read.bricks = std::make_shared<const Bricks<LabelId>>(bricks.take());
  return read;
}

}  // namespace

Result<LabelBricks> label_bricks_of(const plp_labels& labels) {
  const GridGeometry grid = grid_of(labels);
  if (auto fine = check_grid(grid); !fine) return fine.error();
  const std::size_t bytes = bytes_of(labels.type);
  if (bytes == 0)
    return Error{ErrorKind::kBadInput, "voxels of type " + std::to_string(labels.type), "type",
                 "give one of the integer types of plp_type"};
  if (labels.voxels == nullptr)
    return Error{ErrorKind::kBadInput, "the voxels are null", "voxels", "give the address of the first"};
  std::array<std::ptrdiff_t, 3> strides{};
  for (std::size_t axis = 0; axis < 3; ++axis) strides[axis] = labels.strides_bytes[axis];
  if (strides == std::array<std::ptrdiff_t, 3>{}) {
    strides[0] = static_cast<std::ptrdiff_t>(bytes);
    strides[1] = strides[0] * grid.dims[0];
    strides[2] = strides[1] * grid.dims[1];
  }
  switch (labels.type) {
    case PLP_UINT8:
      return read_slices<std::uint8_t>(labels, grid, strides);
    case PLP_INT8:
      return read_slices<std::int8_t>(labels, grid, strides);
    case PLP_UINT16:
      return read_slices<std::uint16_t>(labels, grid, strides);
    case PLP_INT16:
      return read_slices<std::int16_t>(labels, grid, strides);
    case PLP_UINT32:
      return read_slices<std::uint32_t>(labels, grid, strides);
    case PLP_INT32:
      return read_slices<std::int32_t>(labels, grid, strides);
    case PLP_UINT64:
      return read_slices<std::uint64_t>(labels, grid, strides);
    default:
      return read_slices<std::int64_t>(labels, grid, strides);
  }
}

}  // namespace palpate::c
