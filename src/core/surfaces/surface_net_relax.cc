#include <algorithm>
#include <cmath>
#include <queue>

#include "surfaces/surface_net_links.h"

// docs/decisions/0017-surface-nets.md justifies each step and its parameters,
// docs/decisions/archive/0066-where-the-volume-ends.md the treatment of the volume's border.
//
//     membrane        every node at its neighbours' mean, in its cell:    no terraces, but spheres shrink
//     three times     curvature C and area M of the current net, both summed over a node's links
//                     smoothed along the surface, except across edges: C', M'
//                     every node offset from its neighbours' mean by n M C'/M':     restores spheres

namespace palpate::internal {

namespace {

/// Maximum numbers of iterations of solve() for the membrane and after each curvature update, and number of
/// these updates. More iterations with curvature would bend flat regions and restore terraces.
constexpr int kMembraneIterations = 60, kCurvatureIterations = 24, kCurvatureUpdates = 3;
/// Largest displacement of a node per iteration, in voxels, at which the solution is accepted.
constexpr float kTolerance = 3e-4f;
/// Decay factor of the slowest wave to be levelled, per iteration that moves each node to the mean of its
/// neighbours (spectral radius): cos(pi/n)^2 for a wave of n nodes along the surface, here 31.
constexpr float kJacobiSpectralRadius = 0.99f;
/// Widths of Gaussians along the surface.
constexpr float kNormal_mm = 1, kCurvature_mm = 2.5f, kEdge_mm = 1.5f;
/// Sum of the principal curvatures, 1/mm, above which the surface has an edge, which must not bend adjacent
/// faces.
constexpr float kEdgeCurvature = 0.15f;
/// Distance along the surface from the volume's border within which a node's curvature is weighted down by
/// the fourth power of the relative distance, but at least by kMinTrust. A larger distance would affect
/// faces between an edge and the volume's border too much.
constexpr float kBorder_mm = 5, kMinTrust = 1e-3f;
/// Nodes per chunk of work, and minimum number of chunks per thread.
constexpr std::size_t kChunk = 4096;
constexpr int kMinChunks = 6;

/// A link whose opposite one led to a wall. It contributes to the curvature but exerts no pull: unbalanced,
/// it would draw its node along the surface and level a tilted one.
struct Unpaired {
  std::uint32_t node;
  int link;
  std::uint32_t to;
};

/// Mean of the midpoints of a cell's edges between the classes.
CellPosition midway(unsigned classes) {
  CellPosition sum = CellPosition::Zero();
  float count = 0;
  for (unsigned from = 0; from < 8; ++from) {
    for (unsigned a = 0; a < 3; ++a) {
      const unsigned to = from | 1u << a;
      if (to == from || (classes >> from & 1) == (classes >> to & 1)) continue;
      CellPosition at(static_cast<float>(from & 1), static_cast<float>(from >> 1 & 1),
                      static_cast<float>(from >> 2), 0.0f);
      at[a] = 0.5f;
      sum += at;
      ++count;
    }
  }
  return sum / count;
}

/// Solver on a reordered net: nodes whose cells have even i + j + k come first. They are linked only to odd
/// ones (red-black ordering).
class RedBlackSor {
 public:
  RedBlackSor(const SurfaceNet& net, const Span3& known, int threads);

  /// Projected over-relaxation, at most `max_iterations` iterations, until no node moves beyond the
  /// tolerance.
  Result<void> solve(int max_iterations, const Progress& progress);
  /// Updates the nodes' offsets from their neighbours' mean, from the current curvature.
  void update_curvature();
  void write_positions(SurfaceNet& net) const;

 private:
  /// Calls work(first, last) for chunks of a range of nodes.
  template <class Work>
  void over_nodes(std::size_t begin, std::size_t end, const Work& work) const {
    const auto chunks = static_cast<int>((end - begin + kChunk - 1) / kChunk);
    const auto done =
        for_each_slice(chunks, worker_count(threads_, chunks / kMinChunks), {}, {}, [&](int, int n) {
          const std::size_t first = begin + static_cast<std::size_t>(n) * kChunk;
          work(first, std::min(end, first + kChunk));
        });
    PALPATE_CHECK(done.ok());
  }
  template <class Work>
  void over_nodes(const Work& work) const {
    over_nodes(0, positions_.size(), work);
  }
  void unlink_walls(const std::vector<std::uint8_t>& wall);
  void compute_border_divisors();
  void unlink_unpaired();
  void relink_unpaired();
  CellPosition distance_mm(std::size_t n, int link) const;
  float square_along(std::size_t n, int link, const CellPosition& normal) const;
  CellPosition area(std::size_t n) const;
  std::vector<CellPosition> normals() const;
  void smooth(std::vector<CellPosition>& values, float sigma_mm) const;

  int threads_;
  CellPosition spacing_;
  std::size_t even_ = 0;              ///< Number of even nodes
  std::vector<std::uint32_t> order_;  ///< Their indices in the net
  std::vector<std::uint8_t> classes_;
  std::vector<CellPosition> positions_;
  NetLinks links_;
  std::vector<Unpaired> unpaired_;
  /// Divisor of a node's curvature near walls; empty if there are none
  std::vector<float> curvature_divisor_;
  /// Voxels; offset of the links minus the node's target offset from their mean
  std::vector<CellPosition> rest_;
};

RedBlackSor::RedBlackSor(const SurfaceNet& net, const Span3& known, int threads)
    : threads_(threads), order_(net.size()), classes_(net.size()), positions_(net.size()), links_(net) {
  spacing_ << net.spacing_mm[0], net.spacing_mm[1], net.spacing_mm[2], 0.0f;
  std::vector<std::uint32_t> number(net.size());
  std::vector<std::uint8_t> wall(net.size());
  std::uint32_t next = 0;
  for (const int odd : {0, 1}) {
    for_each_row(net.cells, [&](int j, int k) {
      const std::size_t r = net.row(j, k);
      for (std::uint32_t n = net.row_begin[r]; n < net.row_begin[r + 1]; ++n) {
        if (((net.column[n] + j + k) & 1) != odd) continue;
        order_[next] = n;
        const Index3 cell{net.column[n], j, k};
        for (int a = 0; a < 3; ++a)
          if (cell[a] < known.low[a] || cell[a] >= known.high[a]) wall[next] = 1;
        number[n] = next++;
      }
    });
    if (odd == 0) even_ = next;
  }
  const NetLinks links = std::move(links_);
  links_ = NetLinks(net.size());
  for (std::size_t n = 0; n < order_.size(); ++n) {
    const std::uint32_t m = order_[n];
    classes_[n] = net.classes[m];
    positions_[n] = net.positions[m];
    for (int f = 0; f < 6; ++f) links_.to[n][f] = number[links.to[m][f]];
    links_.fraction[n] = links.fraction[m];
    links_.offset[n] = links.offset[m];
  }
  unlink_walls(wall);
  rest_ = links_.offset;
}

/// Removes links from the surface to wall nodes: the wall follows the surface that ends at it, but not vice
/// versa. Surface nodes at a wall start midway: their zero crossings are rounded by the filter beside the
/// wall, and along the border little would restore them.
void RedBlackSor::unlink_walls(const std::vector<std::uint8_t>& wall) {
  for (std::uint32_t n = 0; n < positions_.size(); ++n) {
    auto& to = links_.to[n];
    std::array<bool, 6> parted{};
    for (int f = 0; f < 6; ++f) {
      parted[f] = wall[n] == 0 && wall[to[f]] != 0;
      if (parted[f]) to[f] = n;
    }
    if (parted == std::array<bool, 6>{}) continue;
    positions_[n] = midway(classes_[n]);
    float pulls = 0;
    CellPosition offset = CellPosition::Zero();
    for (int f = 0; f < 6; ++f) {
      if (to[f] == n) continue;
      if (parted[f ^ 1]) {
        unpaired_.push_back({n, f, to[f]});
        continue;
      }
      offset[f / 2] += f % 2 == 0 ? -1.0f : 1.0f;
      ++pulls;
    }
    links_.fraction[n] = pulls > 0 ? 1 / pulls : 0;
    links_.offset[n] = offset * links_.fraction[n];
  }
  compute_border_divisors();
  unlink_unpaired();
}

/// Computes the divisors of curvature near walls. Where the volume's border cuts a terrace, no label
/// determines how the surface continues, and its kink is not curvature.
void RedBlackSor::compute_border_divisors() {
  if (unpaired_.empty()) return;
  std::vector<float> separation_mm(positions_.size(), kBorder_mm);
  using Reached = std::pair<float, std::uint32_t>;
  std::priority_queue<Reached, std::vector<Reached>, std::greater<>> nearest;
  const auto reach = [&](std::uint32_t n, float mm) {
    if (mm >= separation_mm[n]) return;
    separation_mm[n] = mm;
    nearest.push({mm, n});
  };
  for (const Unpaired& u : unpaired_) reach(u.node, 0);
  while (!nearest.empty()) {
    const auto [mm, n] = nearest.top();
    nearest.pop();
    if (mm > separation_mm[n]) continue;
    for (int f = 0; f < 6; ++f) reach(links_.to[n][f], mm + spacing_[f / 2]);
  }
  curvature_divisor_.resize(positions_.size());
  for (std::size_t n = 0; n < positions_.size(); ++n) {
    const float fraction = separation_mm[n] / kBorder_mm;
    curvature_divisor_[n] = 1 / std::max(fraction * fraction * fraction * fraction, kMinTrust);
  }
}

void RedBlackSor::unlink_unpaired() {
  for (const Unpaired& u : unpaired_) links_.to[u.node][u.link] = u.node;
}
void RedBlackSor::relink_unpaired() {
  for (const Unpaired& u : unpaired_) links_.to[u.node][u.link] = u.to;
}

void RedBlackSor::write_positions(SurfaceNet& net) const {
  for (std::size_t n = 0; n < order_.size(); ++n) net.positions[order_[n]] = positions_[n];
}

/// Even and odd nodes alternately move beyond the mean of their neighbours by a factor that increases from 1
/// to the optimum for the slowest waves (Chebyshev acceleration; Varga, Matrix iterative analysis, 2000),
/// then are projected back into their cells.
Result<void> RedBlackSor::solve(int max_iterations, const Progress& progress) {
  std::vector<float> moved(positions_.size() / kChunk + 2);
  float omega = 1;
  for (int iteration = 0; iteration < max_iterations; ++iteration) {
    if (progress.stopped()) return Progress::interrupted();
    float largest = 0;
    for (const bool odd : {false, true}) {
      const std::size_t begin = odd ? even_ : 0, end = odd ? positions_.size() : even_;
      std::fill(moved.begin(), moved.end(), 0.0f);
      over_nodes(begin, end, [&](std::size_t first, std::size_t last) {
        CellPosition farthest = CellPosition::Zero();
        for (std::size_t n = first; n < last; ++n) {
          const CellPosition at = positions_[n];
          const CellPosition pull = links_.difference_sum(positions_, n) * links_.fraction[n] + rest_[n];
          const CellPosition to = (at + omega * pull).max(kCellMargin).min(1 - kCellMargin);
          farthest = farthest.max((to - at).abs());
          positions_[n] = to;
        }
        moved[(first - begin) / kChunk] = farthest.maxCoeff();
      });
      largest = std::max(largest, *std::max_element(moved.begin(), moved.end()));
      const bool at_first = iteration == 0 && !odd;
      omega = 1 / (1 - (at_first ? 0.5f : 0.25f * omega) * kJacobiSpectralRadius * kJacobiSpectralRadius);
    }
    if (largest < kTolerance) break;
  }
  return {};
}

/// Vector from a node to the linked one, mm.
CellPosition RedBlackSor::distance_mm(std::size_t n, int link) const {
  CellPosition displacement = positions_[links_.to[n][link]] - positions_[n];
  displacement[link / 2] += link % 2 == 0 ? -1.0f : 1.0f;
  return displacement * spacing_;
}

/// Squared length of a link's component tangential to the surface, mm2.
float RedBlackSor::square_along(std::size_t n, int link, const CellPosition& normal) const {
  const CellPosition displacement = distance_mm(n, link);
  const float up = (normal * displacement).sum();
  return displacement.square().sum() - up * up;
}

/// Sum of the area vectors of a node's quads, outward.
CellPosition RedBlackSor::area(std::size_t n) const {
  const unsigned classes = classes_[n];
  Eigen::Vector3f sum = Eigen::Vector3f::Zero();
  for (int a = 0; a < 3; ++a) {
    const int b = (a + 1) % 3, c = (a + 2) % 3;
    for (int side = 0; side < 4; ++side) {
      const int sb = side & 1, sc = side >> 1;
      const unsigned from = static_cast<unsigned>(sb << b | sc << c), to = from | 1u << a;
      const bool inside = (classes >> from & 1) != 0;
      if (inside == ((classes >> to & 1) != 0)) continue;
      // both faces at the edge have both classes, so their links exist unless they lead to a wall
      const int beside = 2 * b + sb, above = 2 * c + sc;
      if (links_.to[n][beside] == n || links_.to[n][above] == n) continue;
      const Eigen::Vector3f x = distance_mm(n, beside).head<3>(), y = distance_mm(n, above).head<3>();
      const Eigen::Vector3f z = x + distance_mm(links_.to[n][beside], above).head<3>().matrix();
      sum += ((sb == sc) == inside ? 0.5f : -0.5f) * z.cross(y - x);
    }
  }
  CellPosition vector;
  vector << sum[0], sum[1], sum[2], 0.0f;
  return vector;
}

std::vector<CellPosition> RedBlackSor::normals() const {
  std::vector<CellPosition> normal(positions_.size());
  over_nodes([&](std::size_t first, std::size_t last) {
    for (std::size_t n = first; n < last; ++n) normal[n] = area(n);
  });
  smooth(normal, kNormal_mm);
  for (CellPosition& n : normal) n /= std::max(n.matrix().norm(), 1e-12f);
  return normal;
}

/// Diffusion along the links, by one step of a Runge-Kutta-Legendre method (Meyer, Balsara and Aslam, Journal
/// of Computational Physics 257, 2014), whose number of stages is the square root of the number of explicit
/// steps.
void RedBlackSor::smooth(std::vector<CellPosition>& values, float sigma_mm) const {
  const std::array<float, 3> weight{1 / (spacing_[0] * spacing_[0]), 1 / (spacing_[1] * spacing_[1]),
                                    1 / (spacing_[2] * spacing_[2])};
  const float time = 0.5f * sigma_mm * sigma_mm;
  const float fastest = 4 * (weight[0] + weight[1] + weight[2]);
  const auto stages = static_cast<int>(std::ceil(0.5f * (std::sqrt(1 + 4 * time * fastest) - 1)));
  std::vector<CellPosition> before = values, next(values.size());
  for (int s = 1; s <= stages; ++s) {
    const float mu = static_cast<float>(2 * s - 1) / static_cast<float>(s), nu = 1 - mu;
    const float step = mu * 2 * time / static_cast<float>(stages * stages + stages);
    over_nodes([&](std::size_t first, std::size_t last) {
      for (std::size_t n = first; n < last; ++n) {
        const auto& to = links_.to[n];
        const CellPosition at = values[n];
        CellPosition sum = CellPosition::Zero();
        for (int f = 0; f < 6; ++f) sum += weight[f / 2] * (values[to[f]] - at);
        next[n] = mu * at + nu * before[n] + step * sum;
      }
    });
    std::swap(before, values);
    std::swap(values, next);
  }
}

void RedBlackSor::update_curvature() {
  relink_unpaired();
  const std::vector<CellPosition> normal = normals();
  // Curvature from the rotation of the normals. Computed from positions, a small error of the normal would
  // turn displacements along the surface, caused by the cells' borders, into curvature.
  std::vector<CellPosition> curvature_and_area(positions_.size());
  std::vector<float> area(positions_.size());
  over_nodes([&](std::size_t first, std::size_t last) {
    for (std::size_t n = first; n < last; ++n) {
      float turn = 0, square = 0;
      for (int f = 0; f < 6; ++f) {
        const std::uint32_t m = links_.to[n][f];
        if (m == n) continue;
        turn += ((normal[m] - normal[n]) * distance_mm(n, f)).sum();
        square += square_along(n, f, normal[n]);
      }
      curvature_and_area[n] << -0.5f * turn, 0.25f * square, 0.0f, 0.0f;
      area[n] = 0.25f * square;
    }
  });
  std::vector<CellPosition> nearby = curvature_and_area;
  smooth(nearby, kEdge_mm);
  for (std::size_t n = 0; n < positions_.size(); ++n) {
    const float edge = nearby[n][0] / (kEdgeCurvature * std::max(nearby[n][1], 1e-9f));
    curvature_and_area[n] /=
        (1 + edge * edge * edge * edge) * (curvature_divisor_.empty() ? 1 : curvature_divisor_[n]);
  }
  smooth(curvature_and_area, kCurvature_mm);
  for (const Unpaired& u : unpaired_) area[u.node] -= 0.25f * square_along(u.node, u.link, normal[u.node]);
  unlink_unpaired();
  const CellPosition per_mm = (spacing_ + CellPosition(0, 0, 0, 1)).inverse();
  for (std::size_t n = 0; n < positions_.size(); ++n) {
    const float curvature = curvature_and_area[n][0] / std::max(curvature_and_area[n][1], 1e-9f);
    rest_[n] = links_.offset[n] - normal[n] * per_mm * (curvature * area[n] * links_.fraction[n]);
  }
}

}  // namespace

Result<void> relax_net(SurfaceNet& net, const Span3& known, int threads, const Progress& progress,
                       const ProgressSpan& span) {
  RedBlackSor relaxation(net, known, threads);
  for (int update = 0; update <= kCurvatureUpdates; ++update) {
    if (update > 0) relaxation.update_curvature();
    const auto done = relaxation.solve(update == 0 ? kMembraneIterations : kCurvatureIterations, progress);
    if (!done) return done;
    progress.report(span.stage, span.from + (span.to - span.from) * (update + 1) / (kCurvatureUpdates + 1));
  }
  relaxation.write_positions(net);
  return {};
}

}  // namespace palpate::internal
