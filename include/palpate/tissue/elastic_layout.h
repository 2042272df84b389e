#pragma once

#include <array>
#include <cstddef>
#include <new>
#include <vector>

#include "palpate/geometry/geometry.h"
#include "palpate/volume/bricks.h"

/// Boxes of cubic cells, and the memory layout of the values of their nodes and cells.
namespace palpate {

/// Box of cubic cells in the patient.
struct ElasticBox {
  Point<Patient> corner;  ///< Outermost corner of the first cell
  /// Columns: the box's axes, orthonormal; may be left-handed
  Eigen::Matrix3d axes = Eigen::Matrix3d::Identity();
  double cell_mm = 1;
  std::array<int, 3> cells{0, 0, 0};

  /// Box coordinates of a point: mm from the corner along the axes.
  Eigen::Vector3d local_mm(const Point<Patient>& p) const { return axes.transpose() * (p - corner).eigen(); }
  Point<Patient> patient(const Eigen::Vector3d& local_mm) const {
    return corner + Vector<Patient>(axes * local_mm);
  }
};

/// Box over a region of voxels. Its axes are those of the grid, or the nearest orthogonal ones if the grid is
/// skewed.
ElasticBox elastic_box_of(const GridGeometry& grid, const VoxelBox& region, double cell_mm);

/// Range of a box's cells: low ... high - 1 along each axis. Its nodes are low ... high.
struct CellBox {
  std::array<int, 3> low{0, 0, 0}, high{0, 0, 0};

  bool empty() const { return low[0] >= high[0] || low[1] >= high[1] || low[2] >= high[2]; }
  bool contains_node(int i, int j, int k) const {
    return i >= low[0] && j >= low[1] && k >= low[2] && i <= high[0] && j <= high[1] && k <= high[2];
  }
  /// Bounding box of both.
  CellBox joined(const CellBox& other) const;
  CellBox grown(int by) const;
  /// Intersection with a box of that many cells.
  CellBox clipped(const std::array<int, 3>& cells) const;
};

/// Allocates at multiples of 64 bytes, so that a whole SIMD vector lies in one cache line.
template <class T>
struct CacheLineAllocator {
  using value_type = T;
  CacheLineAllocator() = default;
  template <class U>
  CacheLineAllocator(const CacheLineAllocator<U>&) {}
  T* allocate(std::size_t n) { return static_cast<T*>(::operator new(n * sizeof(T), std::align_val_t(64))); }
  void deallocate(T* p, std::size_t) { ::operator delete(p, std::align_val_t(64)); }
  bool operator==(const CacheLineAllocator&) const { return true; }
};
using ElasticValues = std::vector<float, CacheLineAllocator<float>>;

/// Memory layout of nodal and cell values. Nodes are the corners of cells, one more than cells along an axis:
///
///     node row (j, k)    x x x ...  y y y ...  z z z ...      3 * row floats, row = cells[0] + 1 and more
///     cell row (j, k)    c c c ...                            row floats
///
/// A row is padded to a multiple of the longest SIMD vector. Padding beyond the last node or cell is 0, as
/// are kSpare floats after the last row.
struct ElasticLayout {
  static constexpr int kLanes = 16;
  static constexpr std::size_t kSpare = kLanes;

  ElasticLayout() = default;
  explicit ElasticLayout(const std::array<int, 3>& cells_along)
      : cells(cells_along), row((cells_along[0] + kLanes) / kLanes * kLanes) {}

  std::size_t node(int i, int j, int k, int component) const {
    return (3 * (static_cast<std::size_t>(k) * (cells[1] + 1) + j) + component) * row + i;
  }
  std::size_t cell(int i, int j, int k) const {
    return (static_cast<std::size_t>(k) * cells[1] + j) * row + i;
  }
  std::size_t node_values() const { return node(0, 0, cells[2] + 1, 0); }
  std::size_t cell_values() const { return cell(0, 0, cells[2]); }
  bool contains_cell(int i, int j, int k) const {
    return i >= 0 && j >= 0 && k >= 0 && i < cells[0] && j < cells[1] && k < cells[2];
  }

  std::array<int, 3> cells{0, 0, 0};
  int row = 0;
};

/// Displacements (mm) or forces (N) of all nodes, along the box's axes.
struct ElasticField {
  ElasticField() = default;
  explicit ElasticField(const ElasticLayout& layout)
      : values(layout.node_values() + ElasticLayout::kSpare, 0.0f) {}
  ElasticValues values;
};

}  // namespace palpate
