#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <vector>

#include "palpate/volume/slices.h"
#include "surfaces/surface_block.h"

namespace palpate::internal {

/// A place within a cell, in voxels from its lowest voxel's centre along i, j, k; the fourth is not used, so
/// that a place is one vector of the machine.
using CellPlace = Eigen::Array4f;

/// A constrained surface net (Gibson, MICCAI 1998): a node in every cell that has voxel centres of both
/// classes. As long as a node stays in its cell every centre stays on its side.
///
///     cell     the box between eight neighbouring voxel centres, named by its lowest voxel
///     classes  bit n: corner n is inside; corner i + 2 j + 4 k
///     link     between the nodes of two cells whose common face has both classes
///     quad     of the four nodes around an edge whose ends are of different classes
///
/// Nodes stand in memory's order of their cells.
struct SurfaceNet {
  static constexpr std::uint32_t kNone = 0xffffffffu;

  Span3 cells;
  Eigen::Vector3f spacing_mm = Eigen::Vector3f::Ones();
  std::vector<std::uint32_t> row_begin;  ///< the first node of each row of cells, and one past the last row's
  std::vector<std::int32_t> column;      ///< i of a node's cell
  std::vector<std::uint8_t> classes;
  std::vector<CellPlace> place;

  std::size_t size() const { return column.size(); }
  std::size_t row(int j, int k) const {
    return static_cast<std::size_t>(k - cells.low[2]) * static_cast<std::size_t>(cells.size(1)) +
           static_cast<std::size_t>(j - cells.low[1]);
  }
  /// The node of a cell; kNone where its centres are of one class or it is outside.
  std::uint32_t find(int i, int j, int k) const;
};

/// How far from the borders of its cell a node stays, in voxels.
inline constexpr float kCellMargin = 0.02f;

/// A row of a field from voxel (cells.low[0], j, k) on; its sign is the class, negative inside.
using FieldRow = std::function<const std::int16_t*(int j, int k)>;
/// The net of a field, its nodes at the mean of the places where the field crosses 0 along their cell's
/// edges. The field covers the cells' corners.
SurfaceNet make_net(const FieldRow& field, const Span3& cells, const Eigen::Vector3d& spacing_mm);

/// One without a node, to whose last slices of cells others are appended.
SurfaceNet no_net(const Span3& cells, const GridGeometry& grid);
/// Nodes of the next slices of a net's cells: as if they had been made together.
/// @param part  of all cells of those slices
void append_net(const SurfaceNet& part, SurfaceNet& net);

/// Makes a net as smooth as its cells allow and no smaller (docs/decisions/0017-surface-nets.md). The same
/// bit for bit with any number of threads.
/// @param known  cells between voxels of the volume. Nodes of others are a wall that closes the surface where
///               the volume ends: it does not bend what ends at it.
/// Errors: kInterrupted.
Result<void> relax_net(SurfaceNet& net, const Span3& known, int threads, const Progress& progress,
                       const ProgressSpan& span);

/// What tissue that was cut leaves of a net. Nodes of cells whose classes are as they were stay exactly where
/// they are; the others start midway between classes and are drawn kCarvingRounds times towards the mean of
/// those they are linked to.
/// @param once  the net as it was made
/// @param now   as make_net gives it, from a field of one value on either side; its nodes are moved. Those of
///              cells within kCarvingRounds + 1 of the border of now.cells are not what they would be in a
///              larger net.
void carve_net(const SurfaceNet& once, SurfaceNet& now);
inline constexpr int kCarvingRounds = 4;

/// Calls visit(cell) for every cell of a box in which one net has a node and the other none, or another one.
void for_each_difference(const SurfaceNet& a, const SurfaceNet& b, const Span3& cells,
                         const std::function<void(const Index3& cell)>& visit);

}  // namespace palpate::internal
