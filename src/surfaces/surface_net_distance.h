#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "surfaces/surface_net.h"
#include "surfaces/surface_net_tiles.h"

namespace palpate::internal {

/// The triangles of a net, for the distance to the nearest one. Every quad is cut along its shorter diagonal.
///
///     part  the triangles of a box of cells about 0.6 mm wide, and a disc that holds them
///
/// Which parts may be nearest is decided for a large box of voxels, then for boxes within it, each by what
/// the one around it left; of 4 x 4 voxels those that are left are few.
class NetTriangles {
 public:
  /// @param cells  of which quads are taken: a quad is that of the highest of its four cells
  NetTriangles(const SurfaceNet& net, const Span3& cells);

  /// mm from voxel centres to the nearest triangle, at most reach_mm. Exact: a voxel's bits do not depend on
  /// which others are asked for.
  /// @param wanted  covers `mm`; where it is 0 nothing is written
  void distance(float reach_mm, const Block<std::uint8_t>& wanted, Block<float>& mm) const;

 private:
  /// The fourth is 0: a place or a way is one vector of the machine.
  using Vector = Eigen::Vector4f;
  struct Range {
    std::uint32_t first = 0, last = 0;
  };
  class Search;

  template <class Visit>
  void for_each_quad(const SurfaceNet& net, const Visit& visit) const;
  void add(const std::array<Vector, 4>& corners, std::uint32_t& next);
  void make_parts(const std::vector<Range>& of_place);
  NetDisc around(const Range& triangles) const;
  std::size_t place_of(const Index3& cell) const;
  Vector centre_mm(int i, int j, int k) const {
    return Eigen::Vector4i(i, j, k, 0).cast<float>().cwiseProduct(spacing_mm_);
  }

  Vector spacing_mm_;
  Span3 cells_, places_;  ///< places: parts' boxes of cells, i fastest
  Index3 edge_;           ///< of a place, in cells
  /// By place: how many parts are before it; and one beyond the last.
  std::vector<std::uint32_t> parts_before_;
  std::vector<NetPart> parts_;
  std::vector<NetTriangle> triangles_;
};

}  // namespace palpate::internal
