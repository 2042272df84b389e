#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/volume/slices.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// Position within a cell, in voxels from the centre of its lowest voxel along i, j, k; the fourth component
/// is padding, so that a position is one SIMD vector.
using CellPosition = Eigen::Array4f;

/// Constrained surface net (Gibson, MICCAI 1998): one node in every cell that has voxel centres of both
/// classes. As long as each node stays in its cell, every centre stays on its side of the surface.
///
///     cell     box between eight neighbouring voxel centres, identified by its lowest voxel
///     classes  bit n: corner n is inside; corner i + 2 j + 4 k
///     link     connects the nodes of two cells whose common face has both classes
///     quad     the four nodes around an edge whose ends have different classes
///
/// Nodes are stored in memory order of their cells.
struct SurfaceNet {
  static constexpr std::uint32_t kNone = 0xffffffffu;

  Span3 cells;
  Eigen::Vector3f spacing_mm = Eigen::Vector3f::Ones();
  std::vector<std::uint32_t> row_begin;  ///< First node of each row of cells, and the end of the last row
  std::vector<std::int32_t> column;      ///< Index i of each node's cell
  std::vector<std::uint8_t> classes;
  std::vector<CellPosition> positions;

  std::size_t size() const { return column.size(); }
  std::size_t row(int j, int k) const {
    return static_cast<std::size_t>(k - cells.low[2]) * static_cast<std::size_t>(cells.size(1)) +
           static_cast<std::size_t>(j - cells.low[1]);
  }
  /// Node of a cell; kNone if its centres are of one class or it is outside the net.
  std::uint32_t find(int i, int j, int k) const;
};

/// Minimum distance of a node from the borders of its cell, in voxels.
inline constexpr float kCellMargin = 0.02f;

/// Row of a field starting at voxel (cells.low[0], j, k); the sign is the class, negative inside.
using FieldRow = std::function<const std::int16_t*(int j, int k)>;
/// Net of a field, with nodes at the mean of the zero crossings along their cell's edges. The field covers
/// the cells' corners.
SurfaceNet make_net(const FieldRow& field, const Span3& cells, const Eigen::Vector3d& spacing_mm);

/// Empty net, to which slices of cells are appended.
SurfaceNet empty_net(const Span3& cells, const GridGeometry& grid);
/// Appends the nodes of the next slices of cells; the result equals building both together.
/// @param part  net of all cells of those slices
void append_net(const SurfaceNet& part, SurfaceNet& net);

/// Smooths a net as far as its cells allow, without shrinking it (docs/decisions/0017-surface-nets.md).
/// Bit-identical for any number of threads.
/// @param known  cells between voxels of the volume. Nodes of other cells form a wall that closes the surface
///               at the volume's border and exerts no influence on the surface that ends there.
/// Errors: kInterrupted.
Result<void> relax_net(SurfaceNet& net, const Span3& known, int threads, const Progress& progress,
                       const ProgressSpan& span);

/// Net after tissue was cut. Nodes of cells with unchanged classes keep their exact positions; the others
/// start midway between the classes and are relaxed kCarvingRounds times towards the mean of their linked
/// nodes.
/// @param original  the originally built net
/// @param now       net from make_net() of a field with one value per class; its nodes are moved. Nodes of
///                  cells within kCarvingRounds + 1 of the border of now.cells differ from those in a larger
///                  net
void carve_net(const SurfaceNet& original, SurfaceNet& now);
inline constexpr int kCarvingRounds = 4;

/// Calls visit(cell) for every cell of a box in which the nets differ: only one has a node, or the nodes are
/// not the same.
void for_each_difference(const SurfaceNet& a, const SurfaceNet& b, const Span3& cells,
                         const std::function<void(const Index3& cell)>& visit);

}  // namespace palpate::internal
