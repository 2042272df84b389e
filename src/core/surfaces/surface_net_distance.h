#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "surfaces/surface_net.h"
#include "surfaces/surface_net_tiles.h"

namespace palpate::internal {

/// Triangles of a net, for finding the distance to the nearest one. Every quad is split along its shorter
/// diagonal.
///
///     part  the triangles of a box of cells about 0.6 mm wide, and a disc that bounds them
///
/// Candidate parts are selected for a large box of voxels, then for nested boxes, each from the candidates of
/// the enclosing one; few remain for a tile of voxels.
class NetTriangles {
 public:
  /// @param cells  cells whose quads are included; a quad belongs to the highest of its four cells
  NetTriangles(const SurfaceNet& net, const Span3& cells);

  /// Distance from voxel centres to the nearest triangle, mm, at most reach_mm. Exact, and independent of
  /// which other voxels are requested.
  /// @param requested  covers `mm`; voxels where it is 0 are not written
  void distance(float reach_mm, const Block<std::uint8_t>& requested, Block<float>& mm) const;

 private:
  /// The fourth component is 0, so that a position or difference is one SIMD vector.
  using Vector = Eigen::Vector4f;
  struct Range {
    std::uint32_t first = 0, last = 0;
  };
  class Search;

  template <class Visit>
  void for_each_quad(const SurfaceNet& net, const Visit& visit) const;
  void add(const std::array<Vector, 4>& corners, std::uint32_t& next);
  void make_parts(const std::vector<Range>& of_position);
  NetDisc around(const Range& triangles) const;
  std::size_t index_of(const Index3& cell) const;
  Vector centre_mm(int i, int j, int k) const {
    return Eigen::Vector4i(i, j, k, 0).cast<float>().cwiseProduct(spacing_mm_);
  }

  Vector spacing_mm_;
  Span3 cells_, part_grid_;  ///< Grid of parts' boxes of cells, i fastest
  Index3 edge_;              ///< Edge of a part's box, in cells
  /// Number of parts before each box; and one entry past the end.
  std::vector<std::uint32_t> parts_before_;
  std::vector<NetPart> parts_;
  std::vector<NetTriangle> triangles_;
};

}  // namespace palpate::internal
