#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/sampling/stored_normals.h"
#include "sampling/octahedral.h"
#include "sampling/stored_normals_simd.h"

namespace palpate {

namespace {

using internal::decode_octahedral;
using internal::encode_octahedral;

/// Bits of each number of a normal, and the largest such number.
int bits(NormalEncoding encoding) {
  return encoding == NormalEncoding::kOctahedral24 ? 12 : 8;
}
int levels(NormalEncoding encoding) {
  return (1 << (bits(encoding) - 1)) - 1;
}

/// Encoded normal, in the bit order of stored_normals_simd.h.
/// @param n  unit or zero
std::uint32_t encode(const Eigen::Vector3d& n, NormalEncoding encoding) {
  const int width = bits(encoding), most = levels(encoding);
  const std::uint32_t mask = (1u << width) - 1;
  const auto pack = [&](int number, int index) {
    return (static_cast<std::uint32_t>(number) & mask) << (index * width);
  };
  if (encoding == NormalEncoding::kBytes) {
    const auto component = [&](int axis) { return static_cast<int>(std::lround(n[axis] * most)); };
    return pack(component(0), 0) | pack(component(1), 1) | pack(component(2), 2);
  }
  if (n.isZero(0)) return pack(-most - 1, 0);
  const auto code = encode_octahedral(n, most);
  return pack(code.a, 0) | pack(code.b, 1);
}

Eigen::Vector3d decode(std::uint32_t stored, NormalEncoding encoding) {
  const int width = bits(encoding), most = levels(encoding);
  const auto unpack = [&](int index) {
    const auto number = static_cast<int>((stored >> (index * width)) & ((1u << width) - 1));
    return number > most ? number - (1 << width) : number;
  };
  if (encoding == NormalEncoding::kBytes) return Eigen::Vector3d(unpack(0), unpack(1), unpack(2)) / most;
  if (unpack(0) < -most) return Eigen::Vector3d::Zero();
  return decode_octahedral({unpack(0), unpack(1)}, most);
}

}  // namespace

int normal_bytes(NormalEncoding encoding) {
  return encoding == NormalEncoding::kOctahedral16 ? 2 : 3;
}

Vector<Patient> stored_normal(const Vector<Patient>& unit_normal, NormalEncoding encoding) {
  return Vector<Patient>(decode(encode(unit_normal.eigen(), encoding), encoding)).normalized();
}

StoredNormals::StoredNormals(const GridGeometry& grid, NormalEncoding encoding)
    : grid_(grid), encoding_(encoding), X_VoxelPatient_(grid.X_PatientVoxel().inverse()) {
  PALPATE_CHECK(grid.voxel_count() > 0);
  const double slice = (grid.dims[0] + 2.0) * (grid.dims[1] + 2.0) * bytes_per_voxel();
  PALPATE_CHECK(2 * slice < std::numeric_limits<std::int32_t>::max());
  // padding, because every voxel is read as four bytes
  bytes_.resize(byte_offset(grid.dims[0], grid.dims[1], grid.dims[2]) + 4, 0);
  for (int k = -1; k <= grid.dims[2]; ++k) {
    for (int j = -1; j <= grid.dims[1]; ++j) {
      for (int i = -1; i <= grid.dims[0]; ++i) set_voxel(i, j, k, 0, Eigen::Vector3d::Zero());
    }
  }
}

std::size_t StoredNormals::byte_offset(int i, int j, int k) const {
  const std::size_t row = grid_.dims[0] + 2, slice = row * (grid_.dims[1] + 2);
  return ((k + 1) * slice + (j + 1) * row + (i + 1)) * bytes_per_voxel();
}

void StoredNormals::set_voxel(int i, int j, int k, double value, const Eigen::Vector3d& gradient) {
  const double steepness = gradient.norm();
  const bool flat = !(steepness > 0) || !std::isfinite(steepness);
  const Eigen::Vector3d normal = flat ? Eigen::Vector3d::Zero() : Eigen::Vector3d(-gradient / steepness);
  const long magnitude = std::isfinite(value) ? std::lround(255 * std::clamp(value, 0.0, 1.0)) : 0;
  occupied_voxels_ += magnitude > 0 ? 1 : 0;

  std::uint32_t stored = encode(normal, encoding_) << 8 | static_cast<std::uint32_t>(magnitude);
  std::uint8_t* voxel = bytes_.data() + byte_offset(i, j, k);
  for (int byte = 0; byte < bytes_per_voxel(); ++byte, stored >>= 8)
    voxel[byte] = static_cast<std::uint8_t>(stored & 255);
}

FieldSample StoredNormals::voxel(int i, int j, int k) const {
  const std::uint8_t* voxel = bytes_.data() + byte_offset(i, j, k);
  std::uint32_t normal = 0;
  for (int byte = 1; byte < bytes_per_voxel(); ++byte)
    normal |= static_cast<std::uint32_t>(voxel[byte]) << (8 * (byte - 1));
  return {voxel[0] / 255.0, Vector<Patient>(-decode(normal, encoding_))};
}

template <class T>
StoredNormals StoredNormals::from_ramp_of(const Volume<T>& ramp, NormalEncoding encoding) {
  const GridGeometry& grid = ramp.geometry();
  StoredNormals normals(grid, encoding);
  // inverse transpose of the voxel matrix: gradients per voxel to per mm
  const Eigen::Matrix3d gradient_map = normals.X_VoxelPatient_.linear().transpose();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const auto at = [&](int di, int dj, int dk) {
          return static_cast<double>(ramp.at_or(i + di, j + dj, k + dk, 0));
        };
        const Eigen::Vector3d twice(at(1, 0, 0) - at(-1, 0, 0), at(0, 1, 0) - at(0, -1, 0),
                                    at(0, 0, 1) - at(0, 0, -1));
        normals.set_voxel(i, j, k, at(0, 0, 0) / std::numeric_limits<T>::max(), gradient_map * twice);
      }
    }
  }
  return normals;
}

StoredNormals StoredNormals::from_ramp(const Volume<std::uint8_t>& ramp, NormalEncoding encoding) {
  return from_ramp_of(ramp, encoding);
}
StoredNormals StoredNormals::from_ramp(const Volume<std::uint16_t>& ramp, NormalEncoding encoding) {
  return from_ramp_of(ramp, encoding);
}

StoredNormals StoredNormals::from_field(const GridGeometry& grid, NormalEncoding encoding,
                                        const std::function<FieldSample(const Point<Patient>&)>& field) {
  StoredNormals normals(grid, encoding);
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const FieldSample sample = field(X_PatientVoxel * Point<Voxel>(i, j, k));
        normals.set_voxel(i, j, k, sample.value, sample.gradient.eigen());
      }
    }
  }
  return normals;
}

FieldSample StoredNormals::sample(const Point<Patient>& x) const {
  FieldSample found;
  sample({&x, 1}, {&found, 1});
  return found;
}

void StoredNormals::sample(std::span<const Point<Patient>> points, std::span<FieldSample> samples) const {
  PALPATE_CHECK(points.size() == samples.size());
  const int bytes = bytes_per_voxel();
  const int row = (grid_.dims[0] + 2) * bytes, slice = row * (grid_.dims[1] + 2);
  internal::stored_normals::StoredGrid grid{bytes_.data() + byte_offset(0, 0, 0),
                                            {bytes, row, slice},
                                            {grid_.dims[0], grid_.dims[1], grid_.dims[2]},
                                            {},
                                            encoding_};
  const Eigen::Matrix3d mm_of_voxel = grid_.X_PatientVoxel().linear();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < 3; ++c) grid.mm_of_voxel[r][c] = static_cast<float>(mm_of_voxel(r, c));
  }

  // in chunks, so that nothing is allocated
  constexpr std::size_t kChunk = 32;
  std::array<internal::stored_normals::StoredPoint, kChunk> in_voxels;
  for (std::size_t first = 0; first < points.size(); first += kChunk) {
    const std::size_t count = std::min(kChunk, points.size() - first);
    for (std::size_t n = 0; n < count; ++n) {
      const Point<Voxel> x = X_VoxelPatient_ * points[first + n];
      in_voxels[n] = {{x.x(), x.y(), x.z()}};
    }
    internal::stored_normals::sample_stored(grid, in_voxels.data(), count, &samples[first].value);
  }
}

FieldSample StoredNormals::sample_literal(const Point<Patient>& x) const {
  const Eigen::Vector3d at = (X_VoxelPatient_ * x).eigen();
  for (int axis = 0; axis < 3; ++axis) {
    if (!(at[axis] > -1 && at[axis] < grid_.dims[axis])) return {};
  }
  double weights = 0, magnitudes = 0;
  Vector<Patient> gradients;
  for (int corner = 0; corner < 8; ++corner) {
    std::array<int, 3> index{};
    for (int axis = 0; axis < 3; ++axis)
      index[axis] = static_cast<int>(std::floor(at[axis])) + ((corner >> axis) & 1);
    const FieldSample stored = voxel(index[0], index[1], index[2]);
    const Point<Patient> centre = grid_.X_PatientVoxel() * Point<Voxel>(index[0], index[1], index[2]);
    const double weight = 1 / ((x - centre).norm() + kEpsilonMm);
    weights += weight;
    magnitudes += weight * stored.value;
    gradients += weight * stored.gradient;
  }
  return {magnitudes / weights, gradients.normalized()};
}

}  // namespace palpate
