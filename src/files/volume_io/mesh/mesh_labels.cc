#include "volume_io/mesh/mesh_labels.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

namespace palpate::volume_io {
namespace {

using Vec3 = Eigen::Vector3d;

// ---- closing holes --------------------------------------------------------------------------------------

// merges equal points, and drops triangles with two equal corners
void merge_points(const TriangleMesh& mesh, ClosedMesh& closed) {
  std::vector<std::uint32_t> order(mesh.points.size()), merged(mesh.points.size());
  std::iota(order.begin(), order.end(), 0u);
  const auto key = [&](std::uint32_t n) {
    const Vec3& p = mesh.points[n];
    return std::tuple(p.x(), p.y(), p.z());
  };
  std::ranges::sort(order, {}, key);
  for (std::size_t n = 0; n < order.size(); ++n) {
    if (n == 0 || key(order[n]) != key(order[n - 1])) closed.points.push_back(mesh.points[order[n]]);
    merged[order[n]] = static_cast<std::uint32_t>(closed.points.size() - 1);
  }
  closed.triangles.reserve(mesh.triangles.size());
  for (const auto& [a, b, c] : mesh.triangles) {
    const MeshTriangle triangle{merged[a], merged[b], merged[c]};
    if (triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0])
      closed.triangles.push_back(triangle);
  }
}

using DirectedEdge = std::pair<std::uint32_t, std::uint32_t>;

// edges traversed more often in one direction than in the other, repeated by the difference
std::vector<DirectedEdge> open_edges(const std::vector<MeshTriangle>& triangles) {
  // low corner first; `orientation` is 1 if the edge runs from low to high, otherwise -1
  struct Edge {
    std::uint32_t low, high;
    std::int32_t orientation;
  };
  std::vector<Edge> edges;
  edges.reserve(3 * triangles.size());
  for (const MeshTriangle& t : triangles)
    for (std::size_t n = 0; n < 3; ++n) {
      const std::uint32_t from = t[n], to = t[(n + 1) % 3];
      edges.push_back({std::min(from, to), std::max(from, to), from < to ? 1 : -1});
    }
  std::ranges::sort(edges, [](const Edge& a, const Edge& b) {
    return std::pair(a.low, a.high) < std::pair(b.low, b.high);
  });
  std::vector<DirectedEdge> open;
  for (std::size_t n = 0; n < edges.size();) {
    std::int32_t surplus = 0;
    std::size_t end = n;
    for (; end < edges.size() && edges[end].low == edges[n].low && edges[end].high == edges[n].high; ++end)
      surplus += edges[end].orientation;
    for (; surplus > 0; --surplus) open.emplace_back(edges[n].low, edges[n].high);
    for (; surplus < 0; ++surplus) open.emplace_back(edges[n].high, edges[n].low);
    n = end;
  }
  return open;
}

// Decomposes open edges into loops; at each corner the numbers of incoming and outgoing edges are equal.
std::vector<std::vector<std::uint32_t>> loops_of(std::vector<DirectedEdge> edges) {
  std::ranges::sort(edges);
  std::vector<char> used(edges.size());
  std::vector<std::uint32_t> path;
  std::vector<std::pair<std::uint32_t, std::size_t>> starts;  // first outgoing edge of each corner
  for (std::size_t n = 0; n < edges.size(); ++n)
    if (n == 0 || edges[n].first != edges[n - 1].first) starts.emplace_back(edges[n].first, n);
  // next: first unused outgoing edge of each corner; on_path: position of a corner on the path + 1, 0 if it
  // is not on it
  std::vector<std::size_t> next(starts.size()), on_path(starts.size());
  for (std::size_t n = 0; n < starts.size(); ++n) next[n] = starts[n].second;
  const auto corner_of = [&](std::uint32_t point) {
    return static_cast<std::size_t>(
        std::ranges::lower_bound(starts, point, {}, &std::pair<std::uint32_t, std::size_t>::first) -
        starts.begin());
  };
  std::vector<std::vector<std::uint32_t>> loops;
  for (std::size_t begin = 0; begin < edges.size(); ++begin) {
    if (used[begin]) continue;
    std::uint32_t at = edges[begin].first;
    path.assign(1, at);
    on_path[corner_of(at)] = 1;
    while (true) {
      const std::size_t corner = corner_of(at);
      while (next[corner] < edges.size() && edges[next[corner]].first == at && used[next[corner]])
        ++next[corner];
      // no outgoing edge is left: the path is back at its start
      if (next[corner] == edges.size() || edges[next[corner]].first != at) break;
      used[next[corner]] = 1;
      at = edges[next[corner]].second;
      const std::size_t reached = corner_of(at);
      if (on_path[reached] == 0) {
        path.push_back(at);
        on_path[reached] = path.size();
        continue;
      }
      // a corner reached again closes a loop
      const std::size_t first = on_path[reached] - 1;
      loops.emplace_back(path.begin() + static_cast<std::ptrdiff_t>(first), path.end());
      for (std::size_t n = first + 1; n < path.size(); ++n) on_path[corner_of(path[n])] = 0;
      path.resize(first + 1);
    }
    for (const std::uint32_t point : path) on_path[corner_of(point)] = 0;
  }
  return loops;
}

// ---- intersecting ---------------------------------------------------------------------------------------

struct PlanePoint {
  double x, y;
};

// Intersection of an edge with the plane of a slice; bit-identical for both triangles that share the edge.
PlanePoint intersect_edge(const Vec3& from, const Vec3& to, double z) {
  const bool upwards = from.z() < to.z();
  const Vec3 &low = upwards ? from : to, &high = upwards ? to : from;
  const double fraction = (z - low.z()) / (high.z() - low.z());
  return {low.x() + fraction * (high.x() - low.x()), low.y() + fraction * (high.y() - low.y())};
}

// Changes of the winding number along the rows of a slice, each stored at the first voxel to which it
// applies.
class WindingChanges {
 public:
  WindingChanges(int columns, int rows)
      : columns_(columns),
        rows_(rows),
        changes_(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows)) {}

  // adds a segment of the slice's polygons, directed such that the inside is to its left
  void add(const PlanePoint& from, const PlanePoint& to) {
    const bool upwards = from.y < to.y;
    const PlanePoint &low = upwards ? from : to, &high = upwards ? to : from;
    // rows above `low`, up to and including `high`
    const double first = std::max(std::floor(low.y) + 1, 0.0),
                 last = std::min(std::floor(high.y), rows_ - 1.0);
    for (double row = first; row <= last; ++row) {
      const double fraction = (row - low.y) / (high.y - low.y);
      const double x = std::ceil(low.x + fraction * (high.x - low.x));
      if (x >= columns_) continue;
      const auto voxel = static_cast<std::size_t>(std::max(x, 0.0));
      changes_[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) + voxel] +=
          upwards ? -1 : 1;
    }
  }
  std::span<std::int32_t> row(int j) {
    return std::span(changes_).subspan(static_cast<std::size_t>(j) * static_cast<std::size_t>(columns_),
                                       static_cast<std::size_t>(columns_));
  }

 private:
  int columns_, rows_;
  std::vector<std::int32_t> changes_;
};

void cut_triangle(const Vec3& a, const Vec3& b, const Vec3& c, double z, bool mirrored,
                  WindingChanges& turns) {
  const std::array<const Vec3*, 3> corners{&a, &b, &c};
  std::optional<PlanePoint> falling, rising;
  for (std::size_t n = 0; n < 3; ++n) {
    const Vec3 &from = *corners[n], &to = *corners[(n + 1) % 3];
    const bool from_above = from.z() > z, to_above = to.z() > z;
    if (from_above == to_above) continue;
    (from_above ? falling : rising) = intersect_edge(from, to, z);
  }
  if (!falling || !rising) return;
  // a left-handed grid mirrors the mesh
  mirrored ? turns.add(*rising, *falling) : turns.add(*falling, *rising);
}

// Marks the blocks of voxels in which the fans can affect the result.
class FanBlocks {
 public:
  static constexpr int kSize = 8;
  FanBlocks(const FastWinding& fans, const GridGeometry& grid) : fans_(fans), X_(grid.X_PatientVoxel()) {
    across_ = (grid.dims[0] + kSize - 1) / kSize;
    down_ = (grid.dims[1] + kSize - 1) / kSize;
    radius_ = 0.5 * kSize * grid.spacing_mm.norm();
    matter_.resize(static_cast<std::size_t>(across_) * static_cast<std::size_t>(down_));
  }
  // to be called before each slice; resets the marks at the start of a layer of blocks
  void begin_slice(int k) {
    if (k / kSize == layer_) return;
    layer_ = k / kSize;
    std::ranges::fill(matter_, Matters::kUnknown);
  }
  bool can_matter(int i, int j) {
    Matters& known = matter_[static_cast<std::size_t>(j / kSize) * static_cast<std::size_t>(across_) +
                             static_cast<std::size_t>(i / kSize)];
    if (known == Matters::kUnknown) {
      constexpr double kHalf = 0.5 * (kSize - 1);
      const Point<Patient> centre =
          X_ * Point<Voxel>(i / kSize * kSize + kHalf, j / kSize * kSize + kHalf, layer_ * kSize + kHalf);
      // below this the fans cannot move an integer winding number across 1/2
      constexpr double kLittle = 0.49;
      known = fans_.bound_within(centre.eigen(), radius_, kLittle) >= kLittle ? Matters::kYes : Matters::kNo;
    }
    return known == Matters::kYes;
  }

 private:
  enum class Matters : char { kUnknown, kYes, kNo };
  const FastWinding& fans_;
  Transform<Patient, Voxel> X_;
  int across_ = 0, down_ = 0, layer_ = -1;
  double radius_ = 0;
  std::vector<Matters> matter_;
};

}  // namespace

ClosedMesh closed_mesh(const TriangleMesh& mesh) {
  ClosedMesh closed;
  merge_points(mesh, closed);
  closed.mesh_triangles = closed.triangles.size();
  auto open = open_edges(closed.triangles);
  closed.open_edges = open.size();
  for (const auto& loop : loops_of(std::move(open))) {
    ++closed.loops;
    Vec3 middle = Vec3::Zero();
    for (const std::uint32_t point : loop) middle += closed.points[point];
    const auto apex = static_cast<std::uint32_t>(closed.points.size());
    closed.points.push_back(middle / static_cast<double>(loop.size()));
    for (std::size_t n = 0; n < loop.size(); ++n)
      closed.triangles.push_back({loop[(n + 1) % loop.size()], loop[n], apex});
  }
  return closed;
}

VoxelRuns voxels_of_mesh(const ClosedMesh& mesh, const GridGeometry& grid,
                         const std::function<bool()>& should_continue) {
  const auto X_VoxelPatient = grid.X_PatientVoxel().inverse();
  const auto X_PatientVoxel = grid.X_PatientVoxel();
  std::vector<Vec3> points;
  points.reserve(mesh.points.size());
  for (const Vec3& point : mesh.points) points.push_back((X_VoxelPatient * Point<Patient>(point)).eigen());

  // bounding box of the mesh without its fans, in voxels
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  for (std::size_t n = 0; n < mesh.mesh_triangles; ++n)
    for (const std::uint32_t corner : mesh.triangles[n]) {
      low = low.cwiseMin(points[corner]);
      high = high.cwiseMax(points[corner]);
    }
  std::array<int, 3> first{}, last{};
  for (int a = 0; a < 3; ++a) {
    const auto at = static_cast<std::size_t>(a);
    const double largest = grid.dims[at] - 1;
    first[at] = static_cast<int>(std::clamp(std::ceil(low[a]), 0.0, largest + 1));
    last[at] = static_cast<int>(std::clamp(std::floor(high[a]), -1.0, largest));
  }
  VoxelRuns voxels(first[2]);
  if (first[0] > last[0] || first[1] > last[1] || first[2] > last[2]) return voxels;

  const FastWinding fans(mesh.points, MeshTriangles(mesh.triangles).subspan(mesh.mesh_triangles));
  if (!should_continue()) return voxels;
  FanBlocks blocks(fans, grid);
  // triangles sorted by their lowest slice, and those that may intersect the current slice
  std::vector<std::uint32_t> order(mesh.triangles.size()), active;
  std::iota(order.begin(), order.end(), 0u);
  const auto lowest = [&](std::uint32_t n) {
    const auto& [a, b, c] = mesh.triangles[n];
    return std::min({points[a].z(), points[b].z(), points[c].z()});
  };
  const auto highest = [&](std::uint32_t n) {
    const auto& [a, b, c] = mesh.triangles[n];
    return std::max({points[a].z(), points[b].z(), points[c].z()});
  };
  std::ranges::sort(order, {}, lowest);
  std::size_t next = 0;
  WindingChanges turns(grid.dims[0], grid.dims[1]);
  const bool mirrored = !grid.right_handed();

  for (int k = first[2]; k <= last[2]; ++k) {
    while (next < order.size() && lowest(order[next]) <= k) active.push_back(order[next++]);
    std::erase_if(active, [&](std::uint32_t n) { return highest(n) <= k; });
    for (const std::uint32_t n : active) {
      const auto& [a, b, c] = mesh.triangles[n];
      cut_triangle(points[a], points[b], points[c], k, mirrored, turns);
    }
    if (!fans.empty()) blocks.begin_slice(k);
    // one voxel more around the box, into which rounding may move intersections
    for (int j = std::max(first[1] - 1, 0); j <= std::min(last[1] + 1, grid.dims[1] - 1); ++j) {
      if (!should_continue()) return voxels;
      const auto row = turns.row(j);
      const bool in_box = j >= first[1] && j <= last[1];
      std::int32_t winding = 0;
      for (int i = std::max(first[0] - 1, 0); i <= std::min(last[0] + 1, grid.dims[0] - 1); ++i) {
        winding += std::exchange(row[static_cast<std::size_t>(i)], 0);
        if (!in_box || i < first[0] || i > last[0]) continue;
        double winding_number = winding;
        if (!fans.empty() && blocks.can_matter(i, j))
          winding_number -= fans.at((X_PatientVoxel * Point<Voxel>(i, j, k)).eigen());
        if (!(std::abs(winding_number) > 0.5)) continue;
        voxels.add(static_cast<std::uint32_t>(j) * static_cast<std::uint32_t>(grid.dims[0]) +
                   static_cast<std::uint32_t>(i));
      }
    }
    voxels.end_slice();
  }
  return voxels;
}

}  // namespace palpate::volume_io
