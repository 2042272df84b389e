#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <new>
#include <utility>
#include <vector>

#include "palpate/base/check.h"
#include "palpate/geometry/geometry.h"

namespace palpate {

/// Position of a regular voxel grid in the patient. Any direction matrix, including oblique, permuted and
/// left-handed ones; its columns are the patient directions of the i, j and k axes.
struct GridGeometry {
  std::array<int, 3> dims{0, 0, 0};                         ///< Voxels along i, j, k.
  Eigen::Vector3d spacing_mm = Eigen::Vector3d::Ones();     ///< Voxel spacing along i, j, k; > 0.
  Eigen::Matrix3d direction = Eigen::Matrix3d::Identity();  ///< Unit columns, invertible.
  Point<Patient> origin;                                    ///< Centre of voxel (0,0,0); LPS mm.

  std::size_t voxel_count() const {
    return static_cast<std::size_t>(dims[0]) * static_cast<std::size_t>(dims[1]) *
           static_cast<std::size_t>(dims[2]);
  }
  double voxel_volume_mm3() const { return spacing_mm.prod() * std::abs(direction.determinant()); }
  double min_spacing_mm() const { return spacing_mm.minCoeff(); }
  bool right_handed() const { return direction.determinant() > 0; }

  /// Transform from continuous voxel indices to LPS millimetres.
  Transform<Patient, Voxel> X_PatientVoxel() const {
    return {direction * spacing_mm.asDiagonal(), origin.eigen()};
  }
  Point<Patient> centre() const {
    return X_PatientVoxel() * Point<Voxel>(0.5 * (dims[0] - 1), 0.5 * (dims[1] - 1), 0.5 * (dims[2] - 1));
  }
  /// Offset of voxel (i,j,k) in memory, i fastest.
  std::size_t offset(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * dims[1] + static_cast<std::size_t>(j)) * dims[0] +
           static_cast<std::size_t>(i);
  }
  bool contains(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < dims[0] && j < dims[1] && k < dims[2];
  }
  /// True if both grids have equal dimensions and their corners coincide to within `tolerance_voxels`.
  bool same_grid(const GridGeometry& other, double tolerance_voxels = 1e-3) const;
};

/// Voxels of type T on a grid, i fastest, then j, then k.
template <class T>
class Volume {
 public:
  Volume() = default;
  /// Throws std::bad_alloc if a dimension is negative or the memory does not suffice.
  explicit Volume(const GridGeometry& geometry, T fill = T{})
      : geometry_(geometry), voxels_(allocated_voxels(geometry), fill) {}
  Volume(const GridGeometry& geometry, std::vector<T> voxels)
      : geometry_(geometry), voxels_(std::move(voxels)) {
    PALPATE_CHECK(voxels_.size() == geometry_.voxel_count());
  }

  const GridGeometry& geometry() const { return geometry_; }
  const std::vector<T>& voxels() const { return voxels_; }
  std::vector<T>& voxels() { return voxels_; }
  bool empty() const { return voxels_.empty(); }
  T& at(int i, int j, int k) { return voxels_[geometry_.offset(i, j, k)]; }
  const T& at(int i, int j, int k) const { return voxels_[geometry_.offset(i, j, k)]; }
  /// Voxel (i,j,k), or `outside` if the index lies outside the grid.
  T at_or(int i, int j, int k, T outside) const {
    return geometry_.contains(i, j, k) ? at(i, j, k) : outside;
  }

 private:
  // number of voxels, if as many can be allocated at all
  static std::size_t allocated_voxels(const GridGeometry& geometry) {
    std::size_t left = std::vector<T>().max_size();
    for (const int dim : geometry.dims) {
      if (dim < 0) throw std::bad_alloc();
      if (dim > 0) left /= static_cast<std::size_t>(dim);
    }
    if (left == 0) throw std::bad_alloc();
    return geometry.voxel_count();
  }

  GridGeometry geometry_;
  std::vector<T> voxels_;
};

struct Rgb {
  std::uint8_t r = 200, g = 200, b = 200;
  bool operator==(const Rgb&) const = default;
};

using LabelId = std::uint16_t;  ///< Segment id; 0 is background.
/// Number of label values, including background.
inline constexpr std::size_t kLabelValues = std::size_t{std::numeric_limits<LabelId>::max()} + 1;

}  // namespace palpate
