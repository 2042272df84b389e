#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "palpate/sampling/normal_encoding.h"
#include "palpate/sampling/sampling.h"
#include "palpate/volume/volume.h"

/// Normals stored with the voxels: a force method without a prepared field. The literal form in double is its
/// definition; the vector form, used in a tick, is bit-identical on every SIMD target and in every build, for
/// a single point and for batches, and does not allocate, lock or throw. Points outside the volume, or with a
/// NaN coordinate, are free space with value 0.
namespace palpate {

/// Bytes of an encoded normal.
int normal_bytes(NormalEncoding encoding);

/// Encodes and decodes a unit normal. Returns a unit vector, or zero for zero.
Vector<Patient> stored_normal(const Vector<Patient>& unit_normal, NormalEncoding encoding);

/// The first method of the founding work: every voxel centre stores a magnitude m (1 byte, of 255) and an
/// outward normal n in the patient frame. Between centres, with the distances d in mm to the eight
/// surrounding centres:
///
///   w = 1 / (d + eps),     I = sum(w m) / sum(w),     N = sum(w n) / |sum(w n)|,     eps = 0.001 mm
///
/// Exactly as published, hence with a cusp at every centre and a discontinuity at every face between two
/// cells, where four of the eight centres are replaced. Voxels outside the grid have m = 0 and no normal; a
/// whole voxel outside, the value is 0.
class StoredNormals {
 public:
  static constexpr double kEpsilonMm = 1e-3;

  /// From a ramp: magnitudes are its values rounded to 1/255, normals its central differences at the voxel
  /// centres (0 outside), in the patient frame for any grid. No normal where the ramp is flat.
  static StoredNormals from_ramp(const Volume<std::uint8_t>& ramp, NormalEncoding encoding);
  static StoredNormals from_ramp(const Volume<std::uint16_t>& ramp, NormalEncoding encoding);
  /// From any field, evaluated at every voxel centre; values are clamped to 0 ... 1.
  static StoredNormals from_field(const GridGeometry& grid, NormalEncoding encoding,
                                  const std::function<FieldSample(const Point<Patient>&)>& field);

  /// Value I, and as gradient -N, of length 1, or 0 if there is no normal: the direction of the founding
  /// method, F = F_full I N. It is not the derivative of I.
  FieldSample sample(const Point<Patient>& x) const;
  /// Batch version; `samples` and `points` have the same size.
  void sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const;
  /// The definition, in double; within 1e-5 of `sample`.
  FieldSample sample_literal(const Point<Patient>& x) const;

  /// Contents of one voxel: its magnitude 0 ... 1, and minus its normal as gradient.
  FieldSample voxel(int i, int j, int k) const;

  const GridGeometry& geometry() const { return grid_; }
  NormalEncoding encoding() const { return encoding_; }
  int bytes_per_voxel() const { return 1 + normal_bytes(encoding_); }
  /// Number of voxels with a magnitude above 0, which a sparse store would have to hold.
  std::size_t occupied_voxels() const { return occupied_voxels_; }

 private:
  StoredNormals(const GridGeometry& grid, NormalEncoding encoding);
  template <class T>
  static StoredNormals from_ramp_of(const Volume<T>& ramp, NormalEncoding encoding);
  void set_voxel(int i, int j, int k, double value, const Eigen::Vector3d& gradient);
  std::size_t byte_offset(int i, int j, int k) const;

  GridGeometry grid_;
  NormalEncoding encoding_;
  Transform<Voxel, Patient> X_VoxelPatient_;
  std::size_t occupied_voxels_ = 0;
  /// Magnitude, then normal, little-endian, per voxel; with a border of one voxel, so that queries need no
  /// bounds checks.
  std::vector<std::uint8_t> bytes_;
};

}  // namespace palpate
