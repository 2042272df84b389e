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

}  // namespace

Surface::Surface(SignedField position, SignedField normal, double steepest)
    : position_(std::move(position)), normal_(std::move(normal)), steepest_(std::max(1.0, steepest)) {
  std::uint64_t hash = kHashSeed;
  hash_field(hash, position_);
  hash_field(hash, normal_);
  hash_double(hash, steepest_);
  content_hash_ = hash_finish(hash);
}

}  // namespace palpate
