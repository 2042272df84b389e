#pragma once

#include <cstdint>
#include <memory>
#include <variant>

#include "palpate/volume.h"

/// Values and gradients of a prepared field at any point.
namespace palpate {

/// A prepared intensity field: 0 in free space, 1 deep inside the stiffest tissue. Stored as unsigned
/// fractions of full scale in 8 bits (as published) or 16 (finer direction, see docs/methods.md).
/// Outside the volume the field is 0, reached linearly over one voxel: free space, no jump.
class Field {
 public:
  Field() = default;
  explicit Field(Volume<std::uint8_t> volume);
  explicit Field(Volume<std::uint16_t> volume);

  const GridGeometry& geometry() const;
  int bytes_per_voxel() const { return storage_.index() == 0 ? 1 : 2; }
  const Transform<Voxel, Patient>& X_VoxelPatient() const { return X_VoxelPatient_; }
  /// Maps a gradient per voxel to a gradient per mm in the patient frame (inverse transpose).
  const Eigen::Matrix3d& gradient_map() const { return gradient_map_; }
  const std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>>& storage() const { return storage_; }

 private:
  std::variant<Volume<std::uint8_t>, Volume<std::uint16_t>> storage_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  Eigen::Matrix3d gradient_map_ = Eigen::Matrix3d::Identity();
};

struct FieldSample {
  double value = 0;          ///< 0 ... 1
  Vector<Patient> gradient;  ///< per mm; points into the tissue
};

/// Trilinear interpolation of the eight surrounding voxels. x need not be inside the volume.
double sample_value(const Field& field, const Point<Patient>& x);

/// The founding method's sample: seven trilinear interpolations, at x and at +-1 voxel along each
/// axis of the grid, and central differences (MERL c. 1997; docs/methods.md "trilinear").
FieldSample sample_central_differences(const Field& field, const Point<Patient>& x);

}  // namespace palpate
