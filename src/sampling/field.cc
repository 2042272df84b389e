#include "palpate/sampling.h"

namespace palpate {

namespace {

/// The gradient of f(x_voxel(x_patient)) by the chain rule: the transposed Jacobian of the inner map.
Eigen::Matrix3d gradient_map_of(const Transform<Voxel, Patient>& X_VoxelPatient) {
  return X_VoxelPatient.linear().transpose();
}

}  // namespace

Field::Field(Volume<std::uint8_t> volume)
    : storage_(std::move(volume)),
      X_VoxelPatient_(geometry().X_PatientVoxel().inverse()),
      gradient_map_(gradient_map_of(X_VoxelPatient_)) {}

Field::Field(Volume<std::uint16_t> volume)
    : storage_(std::move(volume)),
      X_VoxelPatient_(geometry().X_PatientVoxel().inverse()),
      gradient_map_(gradient_map_of(X_VoxelPatient_)) {}

const GridGeometry& Field::geometry() const {
  return std::visit([](const auto& volume) -> const GridGeometry& { return volume.geometry(); }, storage_);
}

}  // namespace palpate
