#include "palpate/sampling/sampling.h"

#include <limits>

namespace palpate {

namespace internal {

SamplingMap::SamplingMap(const GridGeometry& grid, double scale, double offset, double outside_value,
                         double reach, double gradient_factor)
    : outside(outside_value), X_VoxelPatient(grid.X_PatientVoxel().inverse()) {
  // chain rule for f(x_voxel(x_patient)): the transposed Jacobian of the inner map
  gradient_map = X_VoxelPatient.linear().transpose();
  for (int axis = 0; axis < 3; ++axis) {
    for (int column = 0; column < 3; ++column) {
      voxel_columns[column][axis] = X_VoxelPatient.linear()(axis, column);
      sample_columns[column][1 + axis] = gradient_map(axis, column) * (scale * gradient_factor);
    }
    voxel_columns[3][axis] = X_VoxelPatient.translation()[axis];
    low[axis] = -reach;
    high[axis] = grid.dims[axis] - 1 + reach;
  }
  sample_columns[3][0] = scale;
  sample_columns[4][0] = offset;
  low[3] = -1;
  high[3] = 1;
}

}  // namespace internal

namespace {

// central differences read two voxels beyond the grid; SamplingMap applies their factor 1/2
constexpr double kReach = 2, kHalf = 0.5;

template <class T>
internal::SamplingMap ramp_map(const GridGeometry& grid) {
  return {grid, 1.0 / std::numeric_limits<T>::max(), 0, 0, kReach, kHalf};
}

template <class T>
Volume<float> to_values(const Bricks<T>& voxels, const internal::SamplingMap& map) {
  const Volume<T> stored = voxels.dense();
  Volume<float> values(voxels.geometry());
  const double scale = map.sample_columns[3][0], offset = map.sample_columns[4][0];
  std::transform(stored.voxels().begin(), stored.voxels().end(), values.voxels().begin(),
                 [=](T voxel) { return static_cast<float>(offset + scale * voxel); });
  return values;
}

}  // namespace

Field::Field(const Volume<std::uint8_t>& volume) : Field(Bricks<std::uint8_t>(volume, 0)) {}

Field::Field(const Volume<std::uint16_t>& volume) : Field(Bricks<std::uint16_t>(volume, 0)) {}

Field::Field(Bricks<std::uint8_t> voxels) : map_(ramp_map<std::uint8_t>(voxels.geometry())) {
  PALPATE_CHECK(voxels.outside() == 0);
  voxels_ = std::move(voxels);
}

Field::Field(Bricks<std::uint16_t> voxels) : map_(ramp_map<std::uint16_t>(voxels.geometry())) {
  PALPATE_CHECK(voxels.outside() == 0);
  voxels_ = std::move(voxels);
}

const GridGeometry& Field::geometry() const {
  return std::visit([](const auto& voxels) -> const GridGeometry& { return voxels.geometry(); }, voxels_);
}

std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>> Field::storage() const {
  return std::visit(
      [](const auto& voxels) -> std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>> {
        return voxels.dense();
      },
      voxels_);
}

Volume<float> Field::values() const {
  return std::visit([&](const auto& voxels) { return to_values(voxels, map_); }, voxels_);
}

SignedField::SignedField(const Volume<std::int16_t>& volume, const SignedSteps& steps)
    : SignedField(Bricks<std::int16_t>(volume, steps.outside), steps) {}

SignedField::SignedField(Bricks<std::int16_t> voxels, const SignedSteps& steps)
    : steps_(steps),
      voxels_(std::move(voxels)),
      map_(voxels_.geometry(), steps.scale, steps.offset, steps.offset + steps.scale * steps.outside, kReach,
           kHalf) {
  PALPATE_CHECK(voxels_.outside() == steps.outside);
}

SignedField SignedField::with(const PatchOf<std::int16_t>& patch) const {
  SignedField changed = *this;
  changed.voxels_ = voxels_.with(patch);
  return changed;
}

Volume<float> SignedField::values() const {
  return to_values(voxels_, map_);
}

}  // namespace palpate
