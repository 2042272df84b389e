#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "palpate/phantoms/phantoms.h"
#include "palpate/sampling/surface_tree.h"
#include "palpate/surfaces/surfaces.h"

/// Distances to the generated knee's structures by SurfaceTree, compared with a slow independent oracle: the
/// nearest of all triangles of the surface.
namespace palpate {
namespace {

constexpr double kKneeVoxel_mm = 1.5, kOracleWithin_mm = 0.05, kSampled_mm = 20;
constexpr int kPlacesOfEach = 24;
// number of parts of a voxel edge; the error of chords is then below the tolerance
constexpr int kParts = 4;

using Corner = Eigen::Vector3d;

/// Where a surface's trilinear interpolant is 0, by tetrahedra of parts of the voxels (marching tetrahedra).
class Triangles {
 public:
  explicit Triangles(const Surface& surface)
      : voxels_(surface.distance_field().bricks().dense()), steps_(surface.distance_field().steps()) {
    const auto& dims = voxels_.geometry().dims;
    for (int k = -1; k < dims[2]; ++k)
      for (int j = -1; j < dims[1]; ++j)
        for (int i = -1; i < dims[0]; ++i) cut_cell(i, j, k);
  }
  std::size_t size() const { return all_.size(); }
  const Corner& corner_of(std::size_t triangle) const { return all_[triangle][0]; }

  /// Not signed.
  double distance_mm(const Corner& x) const {
    double smallest = std::numeric_limits<double>::infinity();
    for (const auto& triangle : all_)
      smallest = std::min(smallest, (nearest_in(triangle, x) - x).squaredNorm());
    return std::sqrt(smallest);
  }

 private:
  struct Node {
    Corner at;
    double mm;
  };

  void cut_cell(int i, int j, int k) {
    std::array<double, 8> mm;
    for (int n = 0; n < 8; ++n)
      mm[static_cast<std::size_t>(n)] =
          steps_.offset +
          steps_.scale * voxels_.at_or(i + (n & 1), j + (n >> 1 & 1), k + (n >> 2), steps_.outside);
    const auto inside = std::count_if(mm.begin(), mm.end(), [](double value) { return value < 0; });
    if (inside == 0 || inside == 8) return;
    const auto node = [&](int a, int b, int c) {
      const double u = static_cast<double>(a) / kParts, v = static_cast<double>(b) / kParts,
                   w = static_cast<double>(c) / kParts;
      const auto row = [&](std::size_t n) { return std::lerp(mm[n], mm[n + 1], u); };
      const double value = std::lerp(std::lerp(row(0), row(2), v), std::lerp(row(4), row(6), v), w);
      return Node{(voxels_.geometry().X_PatientVoxel() * Point<Voxel>(i + u, j + v, k + w)).eigen(), value};
    };
    for (int c = 0; c < kParts; ++c)
      for (int b = 0; b < kParts; ++b)
        for (int a = 0; a < kParts; ++a) {
          std::array<Node, 8> cube;
          for (int n = 0; n < 8; ++n)
            cube[static_cast<std::size_t>(n)] = node(a + (n & 1), b + (n >> 1 & 1), c + (n >> 2));
          // six tetrahedra around the diagonal
          constexpr std::array<std::size_t, 6> kRing = {1, 3, 2, 6, 4, 5};
          for (std::size_t n = 0; n < 6; ++n)
            cut_tetrahedron({cube[0], cube[kRing[n]], cube[kRing[(n + 1) % 6]], cube[7]});
        }
  }

  void cut_tetrahedron(std::array<Node, 4> nodes) {
    std::sort(nodes.begin(), nodes.end(), [](const Node& a, const Node& b) { return a.mm < b.mm; });
    const auto between = [&](std::size_t a, std::size_t b) -> Corner {
      const double t = nodes[a].mm / (nodes[a].mm - nodes[b].mm);
      return nodes[a].at + t * (nodes[b].at - nodes[a].at);
    };
    const auto inside =
        std::count_if(nodes.begin(), nodes.end(), [](const Node& node) { return node.mm < 0; });
    if (inside == 1) all_.push_back({between(0, 1), between(0, 2), between(0, 3)});
    if (inside == 3) all_.push_back({between(0, 3), between(1, 3), between(2, 3)});
    if (inside == 2) {
      all_.push_back({between(0, 2), between(0, 3), between(1, 3)});
      all_.push_back({between(0, 2), between(1, 3), between(1, 2)});
    }
  }

  // Ericson, "Real-Time Collision Detection", 5.1.5
  static Corner nearest_in(const std::array<Corner, 3>& t, const Corner& x) {
    const Corner ab = t[1] - t[0], ac = t[2] - t[0], ax = x - t[0], bx = x - t[1], cx = x - t[2];
    const double d1 = ab.dot(ax), d2 = ac.dot(ax);
    if (d1 <= 0 && d2 <= 0) return t[0];
    const double d3 = ab.dot(bx), d4 = ac.dot(bx);
    if (d3 >= 0 && d4 <= d3) return t[1];
    const double vc = d1 * d4 - d3 * d2;
    if (vc <= 0 && d1 >= 0 && d3 <= 0) return t[0] + d1 / (d1 - d3) * ab;
    const double d5 = ab.dot(cx), d6 = ac.dot(cx);
    if (d6 >= 0 && d5 <= d6) return t[2];
    const double vb = d5 * d2 - d1 * d6;
    if (vb <= 0 && d2 >= 0 && d6 <= 0) return t[0] + d2 / (d2 - d6) * ac;
    const double va = d3 * d6 - d5 * d4;
    if (va <= 0 && d4 >= d3 && d5 >= d6) return t[1] + (d4 - d3) / ((d4 - d3) + (d5 - d6)) * (t[2] - t[1]);
    const double whole = va + vb + vc;
    // no triangle, but a line or a place that its corners are on
    if (!(whole > 0)) return t[0];
    return t[0] + vb / whole * ab + vc / whole * ac;
  }

  Volume<std::int16_t> voxels_;
  SignedSteps steps_;
  std::vector<std::array<Corner, 3>> all_;
};

TEST(KneeDistances, AreThoseOfEveryTriangle) {
  std::mt19937 random(test::test_seed());
  SCOPED_TRACE("PALPATE_TEST_SEED=" + std::to_string(test::test_seed()));
  const auto phantom = make_knee_phantom(kKneeVoxel_mm);
  ASSERT_TRUE(phantom.ok());
  std::normal_distribution<double> one;
  double max_mm = 0;
  for (const Segment& segment : phantom->labels.segments) {
    SCOPED_TRACE(segment.name);
    const auto prepared = prepare_surfaces(
        *label_bricks(phantom->labels.layers[static_cast<std::size_t>(segment.layer)]), {segment.value}, {});
    ASSERT_TRUE(prepared.ok());
    const auto surface = std::make_shared<const Surface>(prepared->front().surface);
    const Triangles triangles(*surface);
    const SurfaceTree tree(surface);
    ASSERT_GT(triangles.size(), 100u);
    for (int n = 0; n < kPlacesOfEach; ++n) {
      // from deep inside to far outside, most of them near
      const double away_mm = 8 * std::abs(one(random));
      const double z = one(random), y = one(random), x = one(random);
      const Corner at =
          triangles.corner_of(random() % triangles.size()) + away_mm * Corner(x, y, z).normalized();
      const double truth_mm = triangles.distance_mm(at);
      const auto found = tree.nearest(Point<Patient>(at), kSampled_mm);
      if (!found) {
        EXPECT_GT(truth_mm, kSampled_mm - kOracleWithin_mm);
        continue;
      }
      max_mm = std::max(max_mm, std::abs(std::abs(found->distance_mm) - truth_mm));
      EXPECT_NEAR(std::abs(found->distance_mm), truth_mm, kOracleWithin_mm)
          << "at " << at.transpose() << " of " << triangles.size() << " triangles";
    }
  }
  std::printf("  off by %.3f mm at most\n", max_mm);
}

}  // namespace
}  // namespace palpate
