#include "palpate/surface.h"

#include "base/hash.h"

namespace palpate {
namespace {

void hash_field(std::uint64_t& hash, const SignedField& field) {
  const GridGeometry& grid = field.geometry();
  for (const int dim : grid.dims) hash_word(hash, static_cast<std::uint64_t>(dim));
  const Eigen::Matrix3d& map = field.X_VoxelPatient().linear();
  const Eigen::Vector3d& origin = field.X_VoxelPatient().translation();
  for (int axis = 0; axis < 3; ++axis) {
    for (int column = 0; column < 3; ++column) hash_double(hash, map(axis, column));
    hash_double(hash, origin[axis]);
  }
  const SignedSteps& steps = field.steps();
  hash_double(hash, steps.scale);
  hash_double(hash, steps.offset);
  hash_word(hash, static_cast<std::uint16_t>(steps.outside));
  const auto length = static_cast<std::size_t>(grid.dims[0]) * sizeof(std::int16_t);
  if (length == 0) return;
  for (int k = 0; k < grid.dims[2]; ++k)
    for (int j = 0; j < grid.dims[1]; ++j) hash_bytes(hash, &field.padded().at(0, j, k), length);
}

// Of the voxels that hold something else than what is outside, with the cells that they reach into; indices.
// Empty (low above high) where there are none.
struct Extent {
  std::array<double, 3> low, high;
};

Extent extent_of(const SignedField& field) {
  const std::array<int, 3>& dims = field.geometry().dims;
  const std::int16_t outside = field.steps().outside;
  std::array<int, 3> first = dims, last{-1, -1, -1};
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      const std::int16_t* row = &field.padded().at(0, j, k);
      int different = 0;
      for (int i = 0; i < dims[0]; ++i) different |= row[i] ^ outside;
      if (different == 0) continue;
      int begin = 0, end = dims[0] - 1;
      while (row[begin] == outside) ++begin;
      while (row[end] == outside) --end;
      const std::array<int, 3> low{begin, j, k}, high{end, j, k};
      for (std::size_t axis = 0; axis < 3; ++axis) {
        first[axis] = std::min(first[axis], low[axis]);
        last[axis] = std::max(last[axis], high[axis]);
      }
    }
  }
  Extent extent;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    extent.low[axis] = first[axis] - 1;
    extent.high[axis] = last[axis] + 1;
  }
  return extent;
}

// Blocks of kBlock cells along each axis. Cell c lies between voxels c and c + 1, from -1, which reaches out
// of the grid, to the last voxel: along an axis of n voxels there are n + 1.
constexpr int kBlock = 8;

int blocks_along(int voxels) {
  return (voxels + kBlock) / kBlock;
}

// the least of the voxels that its cells read, and of what is outside
std::vector<std::int16_t> least_of_blocks(const SignedField& field, const std::array<int, 3>& blocks) {
  const std::array<int, 3>& dims = field.geometry().dims;
  std::vector<std::int16_t> least(static_cast<std::size_t>(blocks[0]) * static_cast<std::size_t>(blocks[1]) *
                                      static_cast<std::size_t>(blocks[2]),
                                  field.steps().outside);
  std::vector<std::int16_t> row_least(static_cast<std::size_t>(blocks[0]));
  for (int k = 0; k < dims[2]; ++k) {
    for (int j = 0; j < dims[1]; ++j) {
      const std::int16_t* row = &field.padded().at(0, j, k);
      for (int b = 0; b < blocks[0]; ++b) {
        const int begin = std::max(0, b * kBlock - 1), end = std::min(dims[0], (b + 1) * kBlock);
        std::int16_t lowest = field.steps().outside;
        for (int i = begin; i < end; ++i) lowest = std::min(lowest, row[i]);
        row_least[static_cast<std::size_t>(b)] = lowest;
      }
      // a voxel is read by the cell before it, too
      for (int above = k / kBlock; above <= (k + 1) / kBlock; ++above) {
        for (int beside = j / kBlock; beside <= (j + 1) / kBlock; ++beside) {
          std::int16_t* into = &least[(static_cast<std::size_t>(above) * static_cast<std::size_t>(blocks[1]) +
                                       static_cast<std::size_t>(beside)) *
                                      static_cast<std::size_t>(blocks[0])];
          for (std::size_t b = 0; b < row_least.size(); ++b) into[b] = std::min(into[b], row_least[b]);
        }
      }
    }
  }
  return least;
}

}  // namespace

Surface::Surface(SignedField position, SignedField normal, double steepest)
    : steepest_(std::max(1.0, steepest)),
      outside_mm_(position.outside()),
      position_(std::move(position)),
      normal_(std::move(normal)) {
  // the corners of the extent, a little farther out for rounding
  constexpr double kRounding_mm = 1e-6;
  const Extent extent = extent_of(position_);
  const auto X_PatientVoxel = position_.geometry().X_PatientVoxel();
  for (unsigned corner = 0; corner < 8; ++corner) {
    const auto end = [&](unsigned axis) {
      return (corner >> axis & 1) != 0 ? extent.high[axis] : extent.low[axis];
    };
    const Eigen::Array3d at = (X_PatientVoxel * Point<Voxel>(end(0), end(1), end(2))).eigen().array();
    if (corner == 0) low_ = high_ = at;
    low_ = low_.min(at - kRounding_mm);
    high_ = high_.max(at + kRounding_mm);
  }

  for (std::size_t axis = 0; axis < 3; ++axis) blocks_[axis] = blocks_along(position_.geometry().dims[axis]);
  least_ = least_of_blocks(position_, blocks_);

  std::uint64_t hash = kHashSeed;
  hash_field(hash, position_);
  hash_field(hash, normal_);
  hash_double(hash, steepest_);
  content_hash_ = hash_finish(hash);
}

double Surface::at_least_mm(const Point<Patient>& x) const {
  const Point<Voxel> p = position_.X_VoxelPatient() * x;
  const std::array<int, 3>& dims = position_.geometry().dims;
  std::array<std::size_t, 3> block;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    if (!(p[axis] >= -1 && p[axis] < dims[a])) return outside_mm_;
    block[a] = static_cast<std::size_t>(static_cast<int>(p[axis] + 1) / kBlock);
  }
  const std::size_t place =
      (block[2] * static_cast<std::size_t>(blocks_[1]) + block[1]) * static_cast<std::size_t>(blocks_[0]) +
      block[0];
  // interpolation rounds
  constexpr double kRounding_mm = 1e-9;
  return position_.steps().offset + position_.steps().scale * least_[place] - kRounding_mm;
}

}  // namespace palpate
