#include "volume_io/mesh/winding_number.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

namespace palpate::volume_io {
namespace {

using Vec3 = Eigen::Vector3d;

constexpr double kFullAngle = 4 * std::numbers::pi;
constexpr std::uint32_t kTrianglesOfLeaf = 8;
// A node is approximated by a dipole at distances greater than kFar radii, provided that the estimated
// truncation error, (radius / distance)^2 area / (4 pi distance^2), is below kLeftOut.
constexpr double kFar = 2, kLeftOut = 2e-5;

}  // namespace

double winding_of_triangle(const Vec3& a, const Vec3& b, const Vec3& c, const Vec3& from) {
  const Vec3 p = a - from, q = b - from, r = c - from;
  const double lp = p.norm(), lq = q.norm(), lr = r.norm();
  const double volume = p.dot(q.cross(r));
  const double denominator = lp * lq * lr + p.dot(q) * lr + q.dot(r) * lp + r.dot(p) * lq;
  if (volume == 0) return 0;
  return 2 * std::atan2(volume, denominator) / kFullAngle;
}

double winding_number(MeshPoints points, MeshTriangles triangles, const Vec3& from) {
  double sum = 0;
  for (const auto& [a, b, c] : triangles) sum += winding_of_triangle(points[a], points[b], points[c], from);
  return sum;
}

FastWinding::FastWinding(MeshPoints points, MeshTriangles triangles) {
  if (triangles.empty()) return;
  std::vector<std::uint32_t> order(triangles.size());
  std::iota(order.begin(), order.end(), 0u);
  nodes_.reserve(2 * triangles.size() / kTrianglesOfLeaf + 2);
  build(order, 0, static_cast<std::uint32_t>(order.size()), points, triangles);
  corners_.reserve(order.size());
  for (const std::uint32_t n : order) {
    const auto& [a, b, c] = triangles[n];
    corners_.push_back({points[a], points[b], points[c]});
  }
}

std::uint32_t FastWinding::build(std::vector<std::uint32_t>& order, std::uint32_t first, std::uint32_t last,
                                 MeshPoints points, MeshTriangles triangles) {
  const auto index = static_cast<std::uint32_t>(nodes_.size());
  nodes_.emplace_back();
  Node node;
  node.first = first;
  node.last = last;
  // area-weighted centre; without area, the mean of the triangles' centroids
  Vec3 weighted_sum = Vec3::Zero(), sum = Vec3::Zero();
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity()), high = -low;
  const auto of = [&](std::uint32_t n) {
    const auto& [a, b, c] = triangles[order[n]];
    const Vec3 centroid = (points[a] + points[b] + points[c]) / 3;
    const Vec3 area = 0.5 * (points[b] - points[a]).cross(points[c] - points[a]);
    return std::pair(centroid, area);
  };
  for (std::uint32_t n = first; n < last; ++n) {
    const auto [centroid, area] = of(n);
    const double size = area.norm();
    weighted_sum += size * centroid;
    sum += centroid;
    node.area += size;
    node.dipole += area;
    low = low.cwiseMin(centroid);
    high = high.cwiseMax(centroid);
  }
  node.middle = node.area > 0 ? Vec3(weighted_sum / node.area) : Vec3(sum / (last - first));
  for (std::uint32_t n = first; n < last; ++n) {
    const auto [centroid, area] = of(n);
    node.moment += (centroid - node.middle) * area.transpose();
    for (const std::uint32_t corner : triangles[order[n]])
      node.radius = std::max(node.radius, (points[corner] - node.middle).norm());
  }
  if (last - first > kTrianglesOfLeaf) {
    int axis = 0;
    (high - low).maxCoeff(&axis);
    const std::uint32_t middle = first + (last - first) / 2;
    std::nth_element(order.begin() + first, order.begin() + middle, order.begin() + last,
                     [&](std::uint32_t m, std::uint32_t n) {
                       const auto point_of = [&](std::uint32_t t) {
                         const auto& [a, b, c] = triangles[t];
                         return points[a][axis] + points[b][axis] + points[c][axis];
                       };
                       return point_of(m) < point_of(n);
                     });
    node.left = build(order, first, middle, points, triangles);
    node.right = build(order, middle, last, points, triangles);
  }
  nodes_[index] = node;
  return index;
}

double FastWinding::at(const Vec3& from) const {
  if (nodes_.empty()) return 0;
  double sum = 0;
  // sufficient for the depth of the tree
  std::array<std::uint32_t, 128> pending;
  std::size_t count = 0;
  pending[count++] = 0;
  while (count > 0) {
    const Node& node = nodes_[pending[--count]];
    const Vec3 r = node.middle - from;
    const double distance = r.norm();
    const double ratio = node.radius / distance;
    if (distance > kFar * node.radius &&
        node.area * ratio * ratio < kLeftOut * kFullAngle * distance * distance) {
      // dipole term, and its derivative contracted with the moment
      const double cube = distance * distance * distance;
      const double moment_term =
          node.moment.trace() / cube - 3 * r.dot(node.moment * r) / (cube * distance * distance);
      sum += (node.dipole.dot(r) / cube + moment_term) / kFullAngle;
    } else if (node.left == 0) {
      for (std::uint32_t n = node.first; n < node.last; ++n)
        sum += winding_of_triangle(corners_[n][0], corners_[n][1], corners_[n][2], from);
    } else {
      pending[count++] = node.left;
      pending[count++] = node.right;
    }
  }
  return sum;
}

double FastWinding::bound_within(const Vec3& centre, double radius, double enough) const {
  if (nodes_.empty()) return 0;
  double sum = 0;
  std::array<std::uint32_t, 128> pending;
  std::size_t count = 0;
  pending[count++] = 0;
  while (count > 0 && sum < enough) {
    const Node& node = nodes_[pending[--count]];
    // An area at a distance of at least `nearest` subtends less than area / nearest^2.
    const double nearest = (node.middle - centre).norm() - node.radius - radius;
    if (nearest > node.radius || (node.left == 0 && nearest > 0)) {
      sum += node.area / (nearest * nearest) / kFullAngle;
    } else if (node.left == 0) {
      // each triangle contributes at most 1/2
      sum += 0.5 * (node.last - node.first);
    } else {
      pending[count++] = node.left;
      pending[count++] = node.right;
    }
  }
  return sum;
}

}  // namespace palpate::volume_io
