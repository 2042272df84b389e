#include "surfaces/surface_net.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "sampling/test_targets.h"
#include "surfaces/surface_net_distance.h"
#include "surfaces/surface_net_links.h"
#include "surfaces/test_surface_shapes.h"

namespace palpate::internal {
namespace {

/// Field with negative steps inside, from a volume of labels.
Volume<std::int16_t> sides_of(const Volume<LabelId>& labels) {
  Volume<std::int16_t> sides(labels.geometry());
  for (std::size_t n = 0; n < sides.voxels().size(); ++n)
    sides.voxels()[n] = labels.voxels()[n] != 0 ? std::int16_t{-300} : std::int16_t{500};
  return sides;
}

SurfaceNet net_of(const Volume<std::int16_t>& sides) {
  Span3 cells = full_span(sides.geometry());
  for (int& high : cells.high) --high;
  return make_net([&](int j, int k) { return sides.voxels().data() + sides.geometry().offset(0, j, k); },
                  cells, sides.geometry().spacing_mm);
}

Volume<std::int16_t> lump(std::mt19937& random) {
  return sides_of(
      test::label_where(test::surface_grid({30, 28, 16}, {0.3, 0.4, 0.8}), [&](const Eigen::Vector3d& p) {
        const Eigen::Vector3d centre(4.4, 5.5, 6.1);
        return (p - centre).norm() < 3.6 + 0.3 * std::sin(3 * p[0]) && random() % 40 != 0;
      }));
}

TEST(SurfaceNet, HasANodeInEveryCellOfBothClasses) {
  std::mt19937 random(test::test_seed());
  const Volume<std::int16_t> sides = lump(random);
  const SurfaceNet net = net_of(sides);
  std::size_t found = 0;
  for_each_row(net.cells, [&](int j, int k) {
    for (int i = 0; i < net.cells.high[0]; ++i) {
      unsigned bits = 0;
      for (int n = 0; n < 8; ++n) {
        if (sides.at(i + n % 2, j + n / 2 % 2, k + n / 4) < 0) bits |= 1u << n;
      }
      const std::uint32_t node = net.find(i, j, k);
      ASSERT_EQ(node != SurfaceNet::kNone, bits != 0 && bits != 255);
      if (node == SurfaceNet::kNone) continue;
      ++found;
      EXPECT_EQ(net.classes[node], bits);
      EXPECT_EQ(net.column[node], i);
    }
  });
  EXPECT_EQ(found, net.size());
  EXPECT_EQ(net.find(-1, 0, 0), SurfaceNet::kNone);
  EXPECT_EQ(net.find(0, 0, net.cells.high[2]), SurfaceNet::kNone);
}

TEST(SurfaceNet, LinksAreSymmetric) {
  std::mt19937 random(test::test_seed());
  const SurfaceNet net = net_of(lump(random));
  const NetLinks links(net);
  std::size_t linked = 0;
  for (std::uint32_t n = 0; n < net.size(); ++n) {
    for (int f = 0; f < 6; ++f) {
      const std::uint32_t m = links.to[n][f];
      if (m == n) continue;
      ++linked;
      EXPECT_EQ(links.to[m][f ^ 1], n);
    }
  }
  EXPECT_GT(linked, 3 * net.size());
}

TEST(SurfaceNet, NodesStayInTheirCellsWithAnyNumberOfThreads) {
  std::mt19937 random(test::test_seed());
  const SurfaceNet made = net_of(lump(random));
  Span3 part = made.cells;
  part.low[0] += 12;
  for (const Span3& known : {made.cells, part}) {
    SurfaceNet one = made, three = made;
    ASSERT_TRUE(relax_net(one, known, 1, {}, {"relaxing"}).ok());
    ASSERT_TRUE(relax_net(three, known, 3, {}, {"relaxing"}).ok());
    for (std::size_t n = 0; n < one.size(); ++n) {
      for (int a = 0; a < 3; ++a) {
        EXPECT_EQ(one.positions[n][a], three.positions[n][a]);
        EXPECT_GE(one.positions[n][a], kCellMargin);
        EXPECT_LE(one.positions[n][a], 1 - kCellMargin);
      }
    }
  }
}

/// A tilted plane that ends in a wall, or in crumbs, beyond the known region.
TEST(SurfaceNet, AdjacentSheetDoesNotBendAnEdge) {
  std::mt19937 random(test::test_seed());
  constexpr int kLast = 30;
  const auto tilted = [&](bool crumbs) {
    return net_of(sides_of(
        test::label_where(test::surface_grid({40, 30, 20}, {0.3, 0.3, 0.6}), [&](const Eigen::Vector3d& p) {
          if (p[0] > 0.3 * kLast + 0.1) return crumbs && random() % 3 == 0;
          return p[2] < 5 + 0.1 * p[0] + 0.04 * p[1];
        })));
  };
  SurfaceNet wall = tilted(false), crumbs = tilted(true);
  Span3 known = wall.cells;
  known.high[0] = kLast;
  ASSERT_TRUE(relax_net(wall, known, 1, {}, {"relaxing"}).ok());
  ASSERT_TRUE(relax_net(crumbs, known, 1, {}, {"relaxing"}).ok());
  int compared = 0;
  for_each_row(known, [&](int j, int k) {
    for (int i = 0; i < kLast; ++i) {
      const std::uint32_t n = wall.find(i, j, k);
      if (n == SurfaceNet::kNone) continue;
      // iterations end when nothing moves, walls included
      for (int a = 0; a < 3; ++a)
        EXPECT_NEAR(wall.positions[n][a], crumbs.positions[crumbs.find(i, j, k)][a], 5e-3f);
      ++compared;
    }
  });
  EXPECT_GT(compared, 800);
}

TEST(SurfaceNet, RelaxationStopsOnRequest) {
  std::mt19937 random(1);
  SurfaceNet net = net_of(lump(random));
  const std::atomic<bool> stop{true};
  const auto done = relax_net(net, net.cells, 1, Progress({}, &stop), {"relaxing"});
  ASSERT_FALSE(done.ok());
  EXPECT_EQ(done.error().kind, ErrorKind::kInterrupted);
}

/// Distance to a line segment, or to a triangle, in double precision.
double distance_to(const Eigen::Vector3d& p, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const double square = (b - a).squaredNorm();
  const double part = square > 0 ? std::clamp((p - a).dot(b - a) / square, 0.0, 1.0) : 0;
  return (p - a - part * (b - a)).norm();
}
double distance_to(const Eigen::Vector3d& p, const std::array<Eigen::Vector3d, 3>& t) {
  const Eigen::Vector3d normal = (t[1] - t[0]).cross(t[2] - t[0]);
  double smallest = 1e9;
  bool over = normal.norm() > 1e-9;
  for (int e = 0; e < 3; ++e) {
    const Eigen::Vector3d &a = t[e], &b = t[(e + 1) % 3];
    smallest = std::min(smallest, distance_to(p, a, b));
    over = over && normal.cross(b - a).dot(p - a) >= 0;
  }
  return over ? std::abs(normal.normalized().dot(p - t[0])) : smallest;
}

/// Both triangles of every quad, split as NetTriangles splits them.
std::vector<std::array<Eigen::Vector3d, 3>> triangles_of(const SurfaceNet& net) {
  std::vector<std::array<Eigen::Vector3d, 3>> all;
  for_each_row(net.cells, [&](int j, int k) {
    for (std::uint32_t n = net.row_begin[net.row(j, k)]; n < net.row_begin[net.row(j, k) + 1]; ++n) {
      for (int a = 0; a < 3; ++a) {
        if ((net.classes[n] & 1) == (net.classes[n] >> (1 << a) & 1)) continue;
        std::array<Eigen::Vector3d, 4> at;
        bool whole_quad = true;
        for (int m = 0; m < 4; ++m) {
          Index3 cell{net.column[n], j, k};
          if (m == 1 || m == 2) --cell[(a + 1) % 3];
          if (m == 2 || m == 3) --cell[(a + 2) % 3];
          const std::uint32_t node = net.find(cell[0], cell[1], cell[2]);
          whole_quad = whole_quad && node != SurfaceNet::kNone;
          if (!whole_quad) break;
          for (int b = 0; b < 3; ++b)
            at[m][b] = (cell[b] + double{net.positions[node][b]}) * double{net.spacing_mm[b]};
        }
        if (!whole_quad) continue;
        const int from = (at[0] - at[2]).squaredNorm() <= (at[1] - at[3]).squaredNorm() ? 0 : 1;
        for (const int beside : {from + 1, (from + 3) % 4})
          all.push_back({at[from], at[beside], at[from + 2]});
      }
    }
  });
  return all;
}

/// A ball with crumbs around it and holes in it.
SurfaceNet crumbly_net(std::mt19937& random) {
  SurfaceNet net = net_of(sides_of(
      test::label_where(test::surface_grid({25, 23, 12}, {0.3, 0.4, 0.8}), [&](const Eigen::Vector3d& p) {
        return ((p - Eigen::Vector3d(2.6, 3.2, 4.1)).norm() < 2.1) != (random() % 60 == 0);
      })));
  EXPECT_TRUE(relax_net(net, net.cells, 1, {}, {"relaxing"}).ok());
  return net;
}

TEST(SurfaceNet, DistanceEqualsTheNearestTriangle) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const SurfaceNet net = crumbly_net(random);
  const auto all_triangles = triangles_of(net);
  const Span3 all{{-4, -3, -2}, {29, 26, 14}};
  const std::vector<std::int64_t> targets = test::all_targets();
  for (const float reach_mm : {0.7f, 2.0f}) {
    Block<float> first(all, 0);
    for (const std::int64_t target : targets) {
      SCOPED_TRACE(test::target_name(target));
      const test::OnlyTargets only(target);
      const NetTriangles triangles(net, net.cells);
      Block<float> mm(all, -1);
      triangles.distance(reach_mm, {all, 1}, mm);
      if (target == targets.front()) {
        std::copy(mm.values().begin(), mm.values().end(), first.values().begin());
        int within = 0;
        for (int n = 0; n < 1000; ++n) {
          Index3 v;
          for (int a = 0; a < 3; ++a)
            v[a] = all.low[a] + static_cast<int>(random() % static_cast<unsigned>(all.size(a)));
          const Eigen::Vector3d p =
              Eigen::Vector3d(v[0], v[1], v[2]).cwiseProduct(net.spacing_mm.cast<double>());
          double smallest = reach_mm;
          for (const auto& t : all_triangles) smallest = std::min(smallest, distance_to(p, t));
          const float found = mm.row(v[1], v[2])[v[0] - all.low[0]];
          ASSERT_NEAR(found, smallest, 2e-5) << v[0] << " " << v[1] << " " << v[2];
          within += smallest < reach_mm ? 1 : 0;
        }
        EXPECT_GT(within, 80);
      }
      ASSERT_TRUE(std::equal(mm.values().begin(), mm.values().end(), first.values().begin()));
    }
  }
}

TEST(SurfaceNet, DistanceIsIndependentOfTheRequestedVoxels) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const SurfaceNet net = crumbly_net(random);
  const NetTriangles triangles(net, net.cells);
  const Span3 all{{-4, -3, -2}, {29, 26, 14}};
  Block<float> mm(all, -1);
  triangles.distance(2, {all, 1}, mm);
  for (int n = 0; n < 30; ++n) {
    Span3 part;
    for (int a = 0; a < 3; ++a) {
      part.low[a] = all.low[a] + static_cast<int>(random() % static_cast<unsigned>(all.size(a)));
      part.high[a] = std::min(all.high[a], part.low[a] + 1 + static_cast<int>(random() % 20));
    }
    Block<std::uint8_t> requested(part.grown({3, 2, 1}), 0);
    for (std::uint8_t& w : requested.values()) w = random() % 3 == 0 ? 1 : 0;
    Block<float> some(part, -1);
    triangles.distance(2, requested, some);
    for_each_row(part, [&](int j, int k) {
      for (int x = 0; x < part.size(0); ++x) {
        const float whole = mm.row(j, k)[part.low[0] + x - all.low[0]];
        ASSERT_EQ(some.row(j, k)[x], requested.row(j, k)[x + 3] != 0 ? whole : -1);
      }
    });
  }
}

}  // namespace
}  // namespace palpate::internal
