#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <vector>

#include "surfaces/surface_net.h"

namespace palpate::internal {

/// Looks up the nodes of a row of cells by column, in ascending order.
class RowOfNodes {
 public:
  /// @param from  lower bound of the columns to be looked up
  RowOfNodes(const SurfaceNet& net, int j, int k, int from) : net_(net) {
    if (j < net.cells.low[1] || j >= net.cells.high[1] || k < net.cells.low[2] || k >= net.cells.high[2])
      return;
    const auto begin = net.column.begin();
    end_ = net.row_begin[net.row(j, k) + 1];
    next_ = static_cast<std::uint32_t>(
        std::lower_bound(begin + net.row_begin[net.row(j, k)], begin + end_, from) - begin);
  }
  std::uint32_t find(int i) {
    while (next_ < end_ && net_.column[next_] < i) ++next_;
    return next_ < end_ && net_.column[next_] == i ? next_ : SurfaceNet::kNone;
  }

 private:
  const SurfaceNet& net_;
  std::uint32_t next_ = 0, end_ = 0;
};

/// Links of a net's nodes.
struct NetLinks {
  explicit NetLinks(const SurfaceNet& net);
  /// Allocates links for `nodes` nodes, to be filled in.
  explicit NetLinks(std::size_t nodes) : to(nodes), fraction(nodes), offset(nodes) {}

  /// Sum over the links of the differences in position within the cells, in voxels, excluding the cells'
  /// offsets.
  CellPosition difference_sum(const std::vector<CellPosition>& positions, std::size_t n) const {
    const auto& l = to[n];
    const CellPosition& at = positions[n];
    return ((positions[l[0]] - at) + (positions[l[1]] - at)) +
           ((positions[l[2]] - at) + (positions[l[3]] - at)) +
           ((positions[l[4]] - at) + (positions[l[5]] - at));
  }

  /// Linked nodes through the faces at low i, high i, low j, high j, low k, high k; the node itself where
  /// there is no link.
  std::vector<std::array<std::uint32_t, 6>> to;
  std::vector<float> fraction;       ///< 1 / number of links
  std::vector<CellPosition> offset;  ///< Mean of the linked cells' offsets
};

}  // namespace palpate::internal
