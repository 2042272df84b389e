#include "palpate/sampling/surface.h"

#include <limits>

#include "palpate/base/hash.h"

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
  hash_word(hash, field.bricks().content_hash());
}

using Brick = BrickLayout;

// Blocks of kBlock cells along each axis, eight per brick. They begin kBorder cells before the grid, so the
// first block with valid queries extends beyond it.
constexpr int kBlock = Brick::kCells / 2;

/// Extends the bounds by the grid's voxels in a brick that differ from the outside value.
void find_different(const Bricks<std::int16_t>& bricks, std::size_t number, const std::array<int, 3>& brick,
                    std::array<int, 3>& first, std::array<int, 3>& last) {
  const std::int16_t outside = bricks.outside();
  const std::int16_t* const voxels = bricks.brick(number);
  if (bricks.is_uniform(number) && voxels[0] == outside) return;
  // voxels that this brick represents, without the border shared with others
  std::array<int, 3> low, count;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    low[axis] = brick[axis] * Brick::kCells - Brick::kBorder;
    count[axis] = std::min(Brick::kCells, bricks.geometry().dims[axis] - low[axis]);
  }
  const auto begin = [&](std::size_t axis) { return std::max(0, -low[axis]); };
  for (int k = begin(2); k < count[2]; ++k) {
    for (int j = begin(1); j < count[1]; ++j) {
      const std::int16_t* const row =
          voxels + Brick::kBefore + (Brick::kBefore + j) * Brick::kRow + (Brick::kBefore + k) * Brick::kSlice;
      for (int i = begin(0); i < count[0]; ++i) {
        if (row[i] == outside) continue;
        const std::array<int, 3> voxel{low[0] + i, low[1] + j, low[2] + k};
        for (std::size_t axis = 0; axis < 3; ++axis) {
          first[axis] = std::min(first[axis], voxel[axis]);
          last[axis] = std::max(last[axis], voxel[axis]);
        }
      }
    }
  }
}

}  // namespace

Surface::Surface(SignedField position, SignedField normal, double max_gradient)
    : max_gradient_(std::max(1.0, max_gradient)),
      outside_mm_(position.outside()),
      distance_field_(std::move(position)),
      normal_field_(std::move(normal)) {
  const Bricks<std::int16_t>& bricks = distance_field_.bricks();
  const std::array<int, 3>& counts = bricks.counts();
  block_minima_.resize(8 * static_cast<std::size_t>(counts[0]) * static_cast<std::size_t>(counts[1]) *
                       static_cast<std::size_t>(counts[2]));
  Voxels different{distance_field_.geometry().dims, {-1, -1, -1}};
  std::size_t brick = 0;
  for (int c = 0; c < counts[2]; ++c) {
    for (int b = 0; b < counts[1]; ++b) {
      for (int a = 0; a < counts[0]; ++a, ++brick) {
        update_block_minimum(brick);
        find_different(bricks, brick, {a, b, c}, different.first, different.last);
      }
    }
  }
  constexpr double kFar = std::numeric_limits<double>::infinity();
  low_.setConstant(kFar);
  high_.setConstant(-kFar);
  extend_bounds(different);
  hash_content();
}

Surface Surface::with(const PatchOf<std::int16_t>& position, const PatchOf<std::int16_t>& normal,
                      double max_gradient) const {
  Surface now = *this;
  now.max_gradient_ = std::max(1.0, max_gradient);
  now.distance_field_ = distance_field_.with(position);
  now.normal_field_ = normal_field_.with(normal);
  const Bricks<std::int16_t>& before = distance_field_.bricks();
  const Bricks<std::int16_t>& after = now.distance_field_.bricks();
  for (std::size_t brick = 0; brick < block_minima_.size() / 8; ++brick)
    if (after.brick(brick) != before.brick(brick)) now.update_block_minimum(brick);
  if (!position.values.empty()) {
    Voxels changed;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      changed.first[axis] = position.box.first[axis];
      changed.last[axis] = changed.first[axis] + position.box.size[axis] - 1;
    }
    now.extend_bounds(changed);
  }
  now.hash_content();
  return now;
}

/// Extends the bounding box by the cells that touch a range of voxels.
void Surface::extend_bounds(const Voxels& different) {
  // margin for rounding
  constexpr double kRounding_mm = 1e-6;
  const auto X_PatientVoxel = distance_field_.geometry().X_PatientVoxel();
  for (unsigned corner = 0; corner < 8; ++corner) {
    const auto end = [&](unsigned axis) -> double {
      return (corner >> axis & 1) != 0 ? different.last[axis] + 1 : different.first[axis] - 1;
    };
    const Eigen::Array3d at = (X_PatientVoxel * Point<Voxel>(end(0), end(1), end(2))).eigen().array();
    low_ = low_.min(at - kRounding_mm);
    high_ = high_.max(at + kRounding_mm);
  }
}

void Surface::update_block_minimum(std::size_t brick) {
  const Bricks<std::int16_t>& bricks = distance_field_.bricks();
  const std::int16_t outside = distance_field_.steps().outside;
  std::int16_t* const least = &block_minima_[8 * brick];
  const std::int16_t* const voxels = bricks.brick(brick);
  if (bricks.is_uniform(brick)) {
    std::fill_n(least, 8, std::min(outside, voxels[0]));
    return;
  }
  for (int block = 0; block < 8; ++block) {
    std::int16_t lowest = outside;
    // a block's cells read its own voxels and the next ones along each axis
    const std::int16_t* const first = voxels + (Brick::kBefore + (block & 1) * kBlock) +
                                      (Brick::kBefore + (block >> 1 & 1) * kBlock) * Brick::kRow +
                                      (Brick::kBefore + (block >> 2) * kBlock) * Brick::kSlice;
    for (int k = 0; k <= kBlock; ++k)
      for (int j = 0; j <= kBlock; ++j)
        for (int i = 0; i <= kBlock; ++i)
          lowest = std::min(lowest, first[i + j * Brick::kRow + k * Brick::kSlice]);
    least[block] = lowest;
  }
}

void Surface::hash_content() {
  std::uint64_t hash = kHashSeed;
  hash_field(hash, distance_field_);
  hash_field(hash, normal_field_);
  hash_double(hash, max_gradient_);
  content_hash_ = hash_finish(hash);
}

double Surface::lower_bound_mm(const Point<Patient>& x) const {
  const Point<Voxel> p = distance_field_.X_VoxelPatient() * x;
  const std::array<int, 3>& dims = distance_field_.geometry().dims;
  std::array<std::size_t, 3> offset;
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    if (!(p[axis] >= -1 && p[axis] < dims[a])) return outside_mm_;
    offset[a] = static_cast<std::size_t>(p[axis] + Brick::kBorder);
  }
  const std::array<int, 3>& counts = distance_field_.bricks().counts();
  constexpr std::size_t kCells = Brick::kCells;
  const auto brick = [&](std::size_t axis) { return offset[axis] / kCells; };
  const auto half = [&](std::size_t axis) { return offset[axis] % kCells / kBlock; };
  const std::size_t block =
      8 * ((brick(2) * static_cast<std::size_t>(counts[1]) + brick(1)) * static_cast<std::size_t>(counts[0]) +
           brick(0)) +
      4 * half(2) + 2 * half(1) + half(0);
  // margin for rounding by the interpolation
  constexpr double kRounding_mm = 1e-9;
  return distance_field_.steps().offset + distance_field_.steps().scale * block_minima_[block] - kRounding_mm;
}

}  // namespace palpate
