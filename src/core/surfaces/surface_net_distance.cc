#include "surfaces/surface_net_distance.h"

#include <algorithm>
#include <cmath>

#include "surfaces/surface_net_links.h"

namespace palpate::internal {

namespace {

constexpr float kPart_mm = 0.6f;
/// Upper bound of the rounding error of a bounding distance.
constexpr float kRoundingOf_mm = 1e-3f;
/// Nested boxes of voxels, in voxels.
constexpr std::array<Index3, 3> kBoxes{{{16, 16, 4}, {8, 8, 2}, {4, 4, 1}}};

bool any(const Block<std::uint8_t>& requested, const Span3& box) {
  bool found = false;
  for_each_row(box, [&](int j, int k) {
    const std::uint8_t* row = requested.row(j, k) + (box.low[0] - requested.span().low[0]);
    found = found || std::any_of(row, row + box.size(0), [](std::uint8_t w) { return w != 0; });
  });
  return found;
}

NetDisc disc_of(const Eigen::Vector4f& middle, const Eigen::Vector4f& normal, float along, float across) {
  NetDisc disc{};
  std::copy_n(middle.data(), 3, disc.middle);
  std::copy_n(normal.data(), 3, disc.normal);
  disc.along = along + kRoundingOf_mm;
  disc.across = across + kRoundingOf_mm;
  return disc;
}

}  // namespace

/// Calls visit(cell, node, below) for each quad: its highest cell, its nodes in order around the edge from
/// the cell's lowest corner, and for each node the axes along which its cell is lower by one, as bits.
template <class Visit>
void NetTriangles::for_each_quad(const SurfaceNet& net, const Visit& visit) const {
  for_each_row(cells_, [&](int j, int k) {
    const int from = cells_.low[0] - 1;
    std::array<RowOfNodes, 4> rows{RowOfNodes(net, j, k, from), RowOfNodes(net, j - 1, k, from),
                                   RowOfNodes(net, j, k - 1, from), RowOfNodes(net, j - 1, k - 1, from)};
    const std::size_t r = net.row(j, k);
    for (std::uint32_t n = net.row_begin[r]; n < net.row_begin[r + 1]; ++n) {
      const Index3 cell{net.column[n], j, k};
      if (cell[0] < cells_.low[0] || cell[0] >= cells_.high[0]) continue;
      // edges at the lowest corner whose ends have different classes
      const unsigned lowest = net.classes[n] & 1u ? 0xffu : 0u, edges = net.classes[n] ^ lowest;
      if ((edges & 0x16u) == 0) continue;
      std::array<std::uint32_t, 8> below;  // index bits: cell lower by one along i, j, k
      for (unsigned m = 0; m < 4; ++m) {
        below[2 * m + 1] = rows[m].find(cell[0] - 1);
        below[2 * m] = rows[m].find(cell[0]);
      }
      for (unsigned a = 0; a < 3; ++a) {
        if ((edges >> (1u << a) & 1u) == 0) continue;
        const unsigned b = 1u << (a + 1) % 3, c = 1u << (a + 2) % 3;
        const std::array<unsigned, 4> around{0, b, b | c, c};
        std::array<std::uint32_t, 4> node;
        for (std::size_t m = 0; m < 4; ++m) node[m] = below[around[m]];
        if (std::find(node.begin(), node.end(), SurfaceNet::kNone) == node.end()) visit(cell, node, around);
      }
    }
  });
}

std::size_t NetTriangles::index_of(const Index3& cell) const {
  std::array<std::size_t, 3> offset;
  for (int a = 0; a < 3; ++a) offset[a] = static_cast<std::size_t>((cell[a] - cells_.low[a]) / edge_[a]);
  return (offset[2] * static_cast<std::size_t>(part_grid_.high[1]) + offset[1]) *
             static_cast<std::size_t>(part_grid_.high[0]) +
         offset[0];
}

NetTriangles::NetTriangles(const SurfaceNet& net, const Span3& cells)
    : spacing_mm_(net.spacing_mm[0], net.spacing_mm[1], net.spacing_mm[2], 0),
      cells_(cells.clipped(net.cells)) {
  for (int a = 0; a < 3; ++a) {
    edge_[a] = std::max(1, static_cast<int>(std::lround(kPart_mm / spacing_mm_[a])));
    part_grid_.high[a] = (cells_.size(a) + edge_[a] - 1) / edge_[a];
  }
  std::vector<Range> of_position(part_grid_.count());
  for_each_quad(net,
                [&](const Index3& cell, const auto&, const auto&) { of_position[index_of(cell)].last += 2; });
  std::uint32_t sum = 0;
  for (Range& range : of_position) {
    range.first = sum;
    sum += range.last;
    range.last = range.first;
  }
  triangles_.resize(sum);
  for_each_quad(net, [&](const Index3& cell, const auto& node, const auto& below) {
    std::array<Vector, 4> corners;
    for (std::size_t m = 0; m < 4; ++m) {
      const auto less = [&](int a) { return static_cast<int>(below[m] >> a & 1u); };
      corners[m] = centre_mm(cell[0] - less(0), cell[1] - less(1), cell[2] - less(2)) +
                   net.positions[node[m]].matrix().cwiseProduct(spacing_mm_);
    }
    add(corners, of_position[index_of(cell)].last);
  });
  make_parts(of_position);
}

void NetTriangles::add(const std::array<Vector, 4>& corners, std::uint32_t& next) {
  const auto inverse = [](float square) { return square > 0 ? 1 / square : 0.0f; };
  const std::size_t from =
      (corners[0] - corners[2]).squaredNorm() <= (corners[1] - corners[3]).squaredNorm() ? 0 : 1;
  for (const std::size_t beside : {from + 1, (from + 3) % 4}) {
    const Vector ab = corners[beside] - corners[from], ac = corners[from + 2] - corners[from];
    NetTriangle& t = triangles_[next];
    std::copy_n(corners[from].data(), 3, t.corner);
    std::copy_n(ab.data(), 3, t.ab);
    std::copy_n(ac.data(), 3, t.ac);
    t.ab_ab = ab.squaredNorm();
    t.ab_ac = ab.dot(ac);
    t.ac_ac = ac.squaredNorm();
    t.per_ab = inverse(t.ab_ab);
    t.per_ac = inverse(t.ac_ac);
    t.per_bc = inverse((ac - ab).squaredNorm());
    const float area = t.ab_ab * t.ac_ac - t.ab_ac * t.ab_ac;
    // a degenerate triangle is represented by its edges only
    t.area = area > 1e-6f * t.ab_ab * t.ac_ac ? area : -1;
    const Vector centre = (ab + ac) / 3, normal = ab.cross3(ac).normalized();
    const float across =
        std::max({centre.squaredNorm(), (ab - centre).squaredNorm(), (ac - centre).squaredNorm()});
    t.disc = disc_of(corners[from] + centre, normal, 0, std::sqrt(across));
    ++next;
  }
}

void NetTriangles::make_parts(const std::vector<Range>& of_position) {
  parts_before_.reserve(of_position.size() + 1);
  parts_before_.push_back(0);
  for (const Range& range : of_position) {
    if (range.first < range.last) parts_.push_back({around(range), range.first, range.last});
    parts_before_.push_back(static_cast<std::uint32_t>(parts_.size()));
  }
}

NetDisc NetTriangles::around(const Range& triangles) const {
  const auto vector = [](const float* v) { return Vector(v[0], v[1], v[2], 0); };
  const auto centre = [&](const NetTriangle& t) { return vector(t.disc.middle); };
  Vector normal = Vector::Zero(), mean = Vector::Zero();
  for (std::uint32_t t = triangles.first; t < triangles.last; ++t) {
    normal += vector(triangles_[t].ab).cross3(vector(triangles_[t].ac));
    mean += centre(triangles_[t]);
  }
  normal /= std::max(normal.norm(), 1e-12f);
  mean /= static_cast<float>(triangles.last - triangles.first);
  // the triangle centroid nearest to the mean of all
  Vector midpoint = centre(triangles_[triangles.first]);
  for (std::uint32_t t = triangles.first + 1; t < triangles.last; ++t) {
    const Vector other = centre(triangles_[t]);
    if ((other - mean).squaredNorm() < (midpoint - mean).squaredNorm()) midpoint = other;
  }
  float along = 0, across = 0;
  for (std::uint32_t t = triangles.first; t < triangles.last; ++t) {
    const NetTriangle& triangle = triangles_[t];
    for (const float* distance : {static_cast<const float*>(nullptr), triangle.ab, triangle.ac}) {
      Vector from = vector(triangle.corner) - midpoint;
      if (distance != nullptr) from += vector(distance);
      const float up = normal.dot(from);
      along = std::max(along, std::abs(up));
      across = std::max(across, (from - up * normal).norm());
    }
  }
  return disc_of(midpoint, normal, along, across);
}

/// Computes the distances of a block, box by box.
class NetTriangles::Search {
 public:
  Search(const NetTriangles& net, float reach_mm, const Block<std::uint8_t>& requested, Block<float>& mm)
      : net_(net), reach_mm_(reach_mm), wanted_(requested), mm_(mm) {}

  void run() {
    for_each_box(mm_.span(), kBoxes[0], [&](const Span3& box) {
      if (!any(wanted_, box)) return;
      gather(box);
      narrow(box, 0);
    });
  }

 private:
  template <class Visit>
  static void for_each_box(const Span3& voxels, const Index3& size, const Visit& visit) {
    Span3 box;
    for (box.low[2] = voxels.low[2]; box.low[2] < voxels.high[2]; box.low[2] += size[2]) {
      for (box.low[1] = voxels.low[1]; box.low[1] < voxels.high[1]; box.low[1] += size[1]) {
        for (box.low[0] = voxels.low[0]; box.low[0] < voxels.high[0]; box.low[0] += size[0]) {
          for (int a = 0; a < 3; ++a) box.high[a] = std::min(voxels.high[a], box.low[a] + size[a]);
          visit(box);
        }
      }
    }
  }

  /// Collects all parts that may be within reach of a box.
  void gather(const Span3& box) {
    Span3 within;
    for (int a = 0; a < 3; ++a) {
      // a quad extends one cell beyond its own
      const int cells = static_cast<int>(std::ceil(reach_mm_ / net_.spacing_mm_[a])) + 2;
      within.low[a] = std::max(0, box.low[a] - cells - net_.cells_.low[a]) / net_.edge_[a];
      within.high[a] = std::max(0, box.high[a] + cells - net_.cells_.low[a]) / net_.edge_[a] + 1;
    }
    within = within.clipped(net_.part_grid_);
    NearParts& near = near_[0];
    near.count = 0;
    for_each_row(within, [&](int j, int k) {
      const std::uint32_t* row =
          net_.parts_before_.data() +
          (static_cast<std::size_t>(k) * static_cast<std::size_t>(net_.part_grid_.high[1]) +
           static_cast<std::size_t>(j)) *
              static_cast<std::size_t>(net_.part_grid_.high[0]);
      const std::uint32_t first = row[within.low[0]], last = row[within.high[0]];
      near.make_room(near.count + (last - first));
      for (std::uint32_t n = first; n < last; ++n) near.add(net_.parts_[n].disc, n);
    });
  }

  /// Selects from the enclosing box's candidates those of this box, recursively down to tiles.
  void narrow(const Span3& box, std::size_t level) {
    const Vector low = net_.centre_mm(box.low[0], box.low[1], box.low[2]);
    const Vector high = net_.centre_mm(box.high[0] - 1, box.high[1] - 1, box.high[2] - 1);
    const Vector centre = 0.5f * (low + high);
    NearParts& near = near_[level + 1];
    select_near(near_[level], {{centre[0], centre[1], centre[2]}, 0.5f * (high - low).norm()}, reach_mm_,
                near);
    if (near.count == 0) {
      fill(box);
    } else if (level + 1 < kBoxes.size()) {
      for_each_box(box, kBoxes[level + 1], [&](const Span3& part) {
        if (any(wanted_, part)) narrow(part, level + 1);
      });
    } else {
      near.move_nearest_first();
      for_each_box(box, {kTileWidth, kTileHeight, 1}, [&](const Span3& tile) { measure(tile, near); });
    }
  }

  void fill(const Span3& box) {
    for_each_requested(box, [&](int, float& mm) { mm = reach_mm_; });
  }

  void measure(const Span3& box, const NearParts& near) {
    NetTile tile;
    for (int n = 0; n < kTileVoxels; ++n) {
      const Vector p = net_.centre_mm(box.low[0] + n % kTileWidth, box.low[1] + n / kTileWidth, box.low[2]);
      tile.x[n] = p[0];
      tile.y[n] = p[1];
      tile.z = p[2];
      tile.squared[n] = reach_mm_ * reach_mm_;
    }
    measure_tile(net_.parts_.data(), net_.triangles_.data(), near, tile);
    for_each_requested(box, [&](int n, float& mm) { mm = std::sqrt(tile.squared[n]); });
  }

  /// Calls set(index in the tile at the box, value).
  template <class Set>
  void for_each_requested(const Span3& box, const Set& set) {
    for_each_row(box, [&](int j, int k) {
      const std::uint8_t* requested = wanted_.row(j, k) + (box.low[0] - wanted_.span().low[0]);
      float* mm = mm_.row(j, k) + (box.low[0] - mm_.span().low[0]);
      for (int i = 0; i < box.size(0); ++i) {
        if (requested[i] != 0) set((j - box.low[1]) * kTileWidth + i, mm[i]);
      }
    });
  }

  const NetTriangles& net_;
  const float reach_mm_;
  const Block<std::uint8_t>& wanted_;
  Block<float>& mm_;
  /// Candidates of the nested boxes, the largest first.
  std::array<NearParts, kBoxes.size() + 1> near_;
};

void NetTriangles::distance(float reach_mm, const Block<std::uint8_t>& requested, Block<float>& mm) const {
  Search(*this, reach_mm, requested, mm).run();
}

}  // namespace palpate::internal
