#include "palpate/surfaces/surfaces.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "base/test_seed.h"
#include "sampling/test_targets.h"
#include "surfaces/test_surface_shapes.h"

namespace palpate {
namespace {

using test::kTissue;

const std::array<Eigen::Vector3d, 2> kClinicalSpacings{Eigen::Vector3d(0.277, 0.277, 1.0),
                                                       Eigen::Vector3d(0.625, 0.625, 0.9)};

PreparedSurface prepared_surfaces(const Volume<LabelId>& labels, const SurfaceOptions& options = {}) {
  auto all = prepare_surfaces(*label_bricks(labels), {kTissue}, options);
  EXPECT_TRUE(all.ok());
  return std::move(all->front());
}

// ---- spheres

struct Directions {
  double radius_mm, mean_deg, p99_deg;
};

/// Angles between the normal and the radius at the intersection of a ray from the centre with the surface.
void expect_directions(const Eigen::Vector3d& spacing, const Directions& limits) {
  const auto seed = test::test_seed();
  SCOPED_TRACE(testing::Message() << "seed " << seed << ", spacing " << spacing.transpose() << ", radius "
                                  << limits.radius_mm);
  std::mt19937 random(seed);
  std::vector<double> angles, errors, angles_away;
  // the same number of rays per radius: larger balls need fewer instances
  const int balls = limits.radius_mm <= 10 ? 6 : limits.radius_mm <= 15 ? 3 : 2;
  for (int n = 0; n < balls; ++n) {
    const test::RandomBall ball(limits.radius_mm, spacing, random);
    const PreparedSurface s = prepared_surfaces(ball.labels);
    for (int ray = 0; ray < 3000 / balls; ++ray) {
      const Eigen::Vector3d d = test::random_direction(random);
      const double r = limits.radius_mm - 1.5 +
                       test::crossing(s.surface, ball.centre + (limits.radius_mm - 1.5) * d, d, 3);
      errors.push_back(r - limits.radius_mm);
      angles.push_back(test::angle_deg(s.surface.outward(Point<Patient>(ball.centre + r * d)).eigen(), d));
      // position of the centre of a tool of 3 mm radius
      angles_away.push_back(
          test::angle_deg(s.surface.outward(Point<Patient>(ball.centre + (r + 3) * d)).eigen(), d));
    }
  }
  const test::Spread angle(angles), error(errors), away(angles_away);
  EXPECT_LE(away.mean, 1);
  EXPECT_LE(away.at(0.99), 4);
  EXPECT_LE(angle.mean, limits.mean_deg);
  EXPECT_LE(angle.at(0.99), limits.p99_deg);
  // a sphere keeps its size
  EXPECT_NEAR(error.mean, 0, 0.09);
  EXPECT_GT(error.at(0.001), -0.5 * spacing.maxCoeff());
  EXPECT_LT(error.at(0.999), 0.5 * spacing.maxCoeff());
  // the mask itself is off by up to half a voxel in each direction
  EXPECT_GT(error.at(0), -0.5 * spacing.norm());
  EXPECT_LT(error.at(1), 0.5 * spacing.norm());
  std::printf(
      "spacing %.3f %.3f r %4.1f: angle mean %.2f p99 %.2f max %.2f deg, 3 mm away %.2f %.2f; radius %+.3f "
      "(%.3f ... "
      "%.3f) mm\n",
      spacing[0], spacing[2], limits.radius_mm, angle.mean, angle.at(0.99), angle.at(1), away.mean,
      away.at(0.99), error.mean, error.at(0), error.at(1));
}

TEST(Surfaces, NormalsOfBallsPointOutward) {
  for (const Eigen::Vector3d& spacing : kClinicalSpacings) {
    for (const Directions& limits :
         {Directions{5, 0.7, 2.5}, Directions{10, 0.5, 2}, Directions{15, 0.5, 2}, Directions{20, 0.5, 2}}) {
      expect_directions(spacing, limits);
    }
  }
}

// ---- thin tissue

/// Every voxel stays on its side, so that the components are those of the mask (26-neighbourhood) and no
/// labelled centre is outside.
void expect_sides_preserved(const PreparedSurface& s, const Volume<LabelId>& labels) {
  const Volume<std::int16_t> position = s.surface.distance_field().bricks().dense();
  const GridGeometry& grid = position.geometry();
  std::size_t wrong = 0;
  for (int k = 0; k < grid.dims[2]; ++k) {
    for (int j = 0; j < grid.dims[1]; ++j) {
      for (int i = 0; i < grid.dims[0]; ++i) {
        const bool inside =
            labels.at_or(i + s.box.first[0], j + s.box.first[1], k + s.box.first[2], 0) == s.label;
        wrong += inside != (position.at(i, j, k) <= 0) ? 1 : 0;
      }
    }
  }
  EXPECT_EQ(wrong, 0u);
}

TEST(Surfaces, PlatesOfOneAndTwoVoxelsSurvive) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> within(-0.5, 0.5);
  for (const Eigen::Vector3d& spacing : kClinicalSpacings) {
    for (int n = 0; n < 12; ++n) {
      const Eigen::Vector3d normal = test::random_direction(random);
      // as thick as one or two voxels along the normal: then the sampling leaves no hole
      const double thick = (1 + n % 2) * normal.cwiseAbs().cwiseProduct(spacing).maxCoeff();
      const Eigen::Vector3d centre = 9 * Eigen::Vector3d::Ones() + within(random) * spacing;
      const std::array<int, 3> dims{static_cast<int>(18 / spacing[0]), static_cast<int>(18 / spacing[1]),
                                    static_cast<int>(18 / spacing[2])};
      const auto labels = test::label_where(test::surface_grid(dims, spacing), [&](const Eigen::Vector3d& p) {
        const double d = (p - centre).dot(normal);
        return std::abs(d) < thick / 2 && (p - centre).squaredNorm() - d * d < 36;
      });
      const PreparedSurface s = prepared_surfaces(labels);
      expect_sides_preserved(s, labels);
    }
  }
}

TEST(Surfaces, ThinPlatesPushOutwardThroughTheirDepth) {
  const Eigen::Vector3d spacing = kClinicalSpacings[0];
  const auto labels =
      test::label_where(test::surface_grid({90, 90, 25}, spacing), [](const Eigen::Vector3d& p) {
        return std::abs(p[1] - 12.4) < 1 && std::abs(p[0] - 12.4) < 8 && std::abs(p[2] - 12) < 8;
      });
  const PreparedSurface s = prepared_surfaces(labels);
  for (const double depth : {0.0, 0.3, 0.6, 0.8}) {
    for (const double side : {-1.0, 1.0}) {
      const Vector<Patient> n = s.surface.outward({12.4, 12.4 + side * (1 - depth), 12});
      EXPECT_GT(side * n.y(), 0.99) << depth;
    }
  }
}

// ---- properties of surfaces

TEST(Surfaces, AreClampedToTheirReachWithoutAStep) {
  std::mt19937 random(2);
  for (const double reach : {2.0, 4.0}) {
    const test::RandomBall ball(3, kClinicalSpacings[1], random);
    const PreparedSurface s = prepared_surfaces(ball.labels, {.reach_mm = reach});
    const Volume<std::int16_t> position = s.surface.distance_field().bricks().dense();
    const auto limit = static_cast<std::int16_t>(reach / kSurfaceStep_mm);
    const GridGeometry& grid = position.geometry();
    for (int k = 0; k < grid.dims[2]; ++k) {
      for (int j = 0; j < grid.dims[1]; ++j) {
        for (int i = 0; i < grid.dims[0]; ++i) {
          const bool border = i == 0 || j == 0 || k == 0 || i + 1 == grid.dims[0] || j + 1 == grid.dims[1] ||
                              k + 1 == grid.dims[2];
          if (border) {
            ASSERT_EQ(position.at(i, j, k), limit);
          }
          ASSERT_LE(position.at(i, j, k), limit);
        }
      }
    }
    EXPECT_DOUBLE_EQ(s.surface.distance_field().outside(), reach);
    EXPECT_DOUBLE_EQ(s.surface.distance_mm({1000, 0, 0}), reach);
  }
}

TEST(Surfaces, SlopesAreWithinMaxGradient) {
  std::mt19937 random(4);
  GridGeometry grid = test::surface_grid({30, 28, 20}, {0.3, 0.5, 0.9});
  grid.direction << 0.6, -0.8, 0, 0.8, 0.6, 0, 0, 0, -1;
  Volume<LabelId> labels(grid);
  for (LabelId& v : labels.voxels()) v = random() % 9 == 0 ? kTissue : LabelId{0};
  const Surface s = prepared_surfaces(labels).surface;
  EXPECT_GE(s.max_gradient(), 1);
  std::uniform_real_distribution<double> u(0, 1);
  double worst = 0;
  for (int n = 0; n < 100000; ++n) {
    const Point<Patient> a =
        grid.X_PatientVoxel() * Point<Voxel>(30 * u(random), 28 * u(random), 20 * u(random));
    const Point<Patient> b = a + Vector<Patient>(0.01 * test::random_direction(random));
    worst = std::max(worst, std::abs(s.distance_mm(a) - s.distance_mm(b)) / (a - b).norm());
  }
  EXPECT_LE(worst, s.max_gradient() + 1e-9);
  EXPECT_GT(worst, 0.7 * s.max_gradient());
}

// ---- determinism

/// Bounds hold at random points around a surface.
void expect_bounds_hold(const Surface& s) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const GridGeometry& grid = s.distance_field().geometry();
  const auto X = grid.X_PatientVoxel();
  std::array<std::uniform_real_distribution<double>, 3> along;
  for (std::size_t axis = 0; axis < 3; ++axis)
    along[axis] = std::uniform_real_distribution<double>(-6, grid.dims[axis] + 5);
  int beyond = 0, less = 0;
  for (int n = 0; n < 2000; ++n) {
    const Point<Patient> p = X * Point<Voxel>(along[0](random), along[1](random), along[2](random));
    less += s.lower_bound_mm(p) > s.distance_mm(p);
    if (s.is_farther_than(p, 0)) beyond += std::abs(s.distance_mm(p) - s.outside_mm()) > 1e-9;
  }
  EXPECT_EQ(less, 0);
  EXPECT_EQ(beyond, 0);
}

void expect_same(const PreparedSurface& a, const PreparedSurface& b) {
  EXPECT_EQ(a.box, b.box);
  EXPECT_EQ(a.intermediates.extent, b.intermediates.extent);
  EXPECT_TRUE(a.intermediates.distance.dense().voxels() == b.intermediates.distance.dense().voxels());
  EXPECT_TRUE(a.surface.distance_field().bricks().dense().voxels() ==
              b.surface.distance_field().bricks().dense().voxels());
  EXPECT_TRUE(a.intermediates.broad.dense().voxels() == b.intermediates.broad.dense().voxels());
  EXPECT_TRUE(a.surface.normal_field().bricks().dense().voxels() ==
              b.surface.normal_field().bricks().dense().voxels());
  EXPECT_TRUE(a.intermediates.slopes == b.intermediates.slopes);
  EXPECT_EQ(a.surface.max_gradient(), b.surface.max_gradient());
  EXPECT_EQ(a.volume_mm3, b.volume_mm3);
  EXPECT_EQ(a.surface.content_hash(), b.surface.content_hash());
  expect_bounds_hold(a.surface);
  expect_bounds_hold(b.surface);
}

/// A lump with a thin sheet, a hole and crumbs.
Volume<LabelId> odd_tissue(const Eigen::Vector3d& spacing, std::mt19937& random) {
  const Eigen::Vector3d extent(21, 20, 22);
  std::array<int, 3> dims;
  for (int a = 0; a < 3; ++a) dims[a] = static_cast<int>(extent[a] / spacing[a]);
  auto labels = test::label_where(test::surface_grid(dims, spacing), [&](const Eigen::Vector3d& p) {
    const double r = (p - extent / 2).norm();
    return (r < 7 && r > 2) || (std::abs(p[2] - 11) < 0.6 && r < 10);
  });
  for (int n = 0; n < 20; ++n) labels.voxels()[random() % labels.voxels().size()] = kTissue;
  return labels;
}

TEST(Surfaces, DoNotDependOnThreadsOrTargets) {
  std::mt19937 random(6);
  const auto labels = odd_tissue({0.4, 0.4, 0.7}, random);
  const PreparedSurface one = prepared_surfaces(labels, {.threads = 1});
  for (const int threads : {0, 2, 3, 7}) expect_same(prepared_surfaces(labels, {.threads = threads}), one);
  for (const std::int64_t target : test::all_targets()) {
    SCOPED_TRACE(test::target_name(target));
    const test::OnlyTargets only(target);
    expect_same(prepared_surfaces(labels), one);
  }
}

TEST(Surfaces, CarvedInManySmallBoxesEqualOneCarving) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (const Eigen::Vector3d& spacing : {Eigen::Vector3d(0.4, 0.4, 0.7), Eigen::Vector3d(0.3, 0.5, 1.0)}) {
    auto labels = odd_tissue(spacing, random);
    const auto& dims = labels.geometry().dims;
    const PreparedSurface once = prepared_surfaces(labels);
    const VoxelBox everything{{0, 0, 0}, dims};
    PreparedSurface now = once;
    int local = 0;
    for (int n = 0; n < 12; ++n) {
      SCOPED_TRACE("edit " + std::to_string(n));
      VoxelBox dirty;
      for (int a = 0; a < 3; ++a) {
        dirty.first[a] = static_cast<int>(random() % static_cast<unsigned>(dims[a])) - 3;
        dirty.size[a] = 1 + static_cast<int>(random() % 10);
      }
      const bool dig = n % 3 != 0;
      for (int k = 0; k < dirty.size[2]; ++k) {
        for (int j = 0; j < dirty.size[1]; ++j) {
          for (int i = 0; i < dirty.size[0]; ++i) {
            const std::array<int, 3> v{dirty.first[0] + i, dirty.first[1] + j, dirty.first[2] + k};
            if (!labels.geometry().contains(v[0], v[1], v[2])) continue;
            labels.at(v[0], v[1], v[2]) = dig || random() % 4 != 0 ? LabelId{0} : kTissue;
          }
        }
      }
      local += prepare_patch(now, *label_bricks(labels), dirty).is_applicable ? 1 : 0;
      auto again = update_surface(now, *label_bricks(labels), dirty);
      ASSERT_TRUE(again.ok());
      // independent of history: only the first version and the current labels matter
      const auto at_once = update_surface(once, *label_bricks(labels), everything);
      ASSERT_TRUE(at_once.ok());
      expect_same(*again, *at_once);
      expect_sides_preserved(*again, labels);
      now = std::move(*again);
    }
    EXPECT_GT(local, 4);
  }
}

TEST(Surfaces, RefilledCutRestoresTheSurface) {
  std::mt19937 random(7);
  const auto labels = odd_tissue({0.4, 0.4, 0.7}, random);
  const PreparedSurface once = prepared_surfaces(labels);
  auto cut = labels;
  const VoxelBox dirty{{20, 18, 10}, {9, 9, 9}};
  for (int k = 0; k < 9; ++k) {
    for (int j = 0; j < 9; ++j) std::fill_n(&cut.at(20, 18 + j, 10 + k), 9, LabelId{0});
  }
  const auto carved = update_surface(once, *label_bricks(cut), dirty);
  ASSERT_TRUE(carved.ok());
  EXPECT_LT(carved->volume_mm3, once.volume_mm3);
  const auto filled = update_surface(*carved, *label_bricks(labels), dirty);
  ASSERT_TRUE(filled.ok());
  expect_same(*filled, once);
}

TEST(Surfaces, CutChangesOnlyItsNeighbourhood) {
  const auto seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  const Eigen::Vector3d spacing = kClinicalSpacings[0];
  const test::RandomBall ball(9, spacing, random);
  const PreparedSurface once = prepared_surfaces(ball.labels);
  auto labels = ball.labels;
  const Eigen::Vector3d top = ball.centre + 9 * test::random_direction(random);
  VoxelBox dirty;
  for (int a = 0; a < 3; ++a) {
    dirty.first[a] = static_cast<int>((top[a] - 3) / spacing[a]);
    dirty.size[a] = static_cast<int>(6 / spacing[a]) + 2;
  }
  const auto dig =
      test::label_where(labels.geometry(), [&](const Eigen::Vector3d& p) { return (p - top).norm() < 3; });
  for (std::size_t n = 0; n < labels.voxels().size(); ++n) {
    if (dig.voxels()[n] != 0) labels.voxels()[n] = 0;
  }
  const auto carved = update_surface(once, *label_bricks(labels), dirty);
  ASSERT_TRUE(carved.ok());
  expect_sides_preserved(*carved, labels);
  int beside = 0, within = 0;
  for (int n = 0; n < 4000; ++n) {
    const Eigen::Vector3d d = test::random_direction(random);
    const Eigen::Vector3d start = ball.centre + 7.5 * d;
    const double r = test::crossing(once.surface, start, d, 3);
    const double from_cut = (start + r * d - top).norm();
    // relaxation affects six cells next to the cut, the longest of them a slice thick
    if (from_cut > 3 + 6 * spacing[2] + 1) {
      ++beside;
      EXPECT_EQ(test::crossing(carved->surface, start, d, 3), r);
    } else if (from_cut < 2) {
      ++within;
      EXPECT_GT(carved->surface.distance_mm(Point<Patient>(Eigen::Vector3d(start + r * d))), 0.5);
    }
  }
  EXPECT_GT(beside, 1000);
  EXPECT_GT(within, 20);
  // a tool of 1.5 mm radius fits into the hole: the distance is that to the remaining material
  EXPECT_GT(carved->surface.distance_mm(Point<Patient>(top)), 1.5);
}

TEST(Surfaces, PatchCoversExactlyTheNeighbourhoodOfACut) {
  const Eigen::Vector3d spacing(0.3, 0.4, 0.5);
  const auto flat = test::label_where(test::surface_grid({90, 70, 40}, spacing),
                                      [](const Eigen::Vector3d& p) { return p[2] < 9.6; });
  const PreparedSurface once = prepared_surfaces(flat);
  auto pitted = flat;
  const VoxelBox pit{{40, 30, 16}, {8, 6, 4}};
  for (int k = 0; k < pit.size[2]; ++k) {
    for (int j = 0; j < pit.size[1]; ++j)
      std::fill_n(&pitted.at(pit.first[0], pit.first[1] + j, pit.first[2] + k), pit.size[0], LabelId{0});
  }
  const SurfacePatch patch = prepare_patch(once, *label_bricks(pitted), pit);
  ASSERT_TRUE(patch.is_applicable);
  // above the pit up to the reach; next to it, at less than the reach from the carved part of the net, the
  // nearest point is unchanged
  for (const int a : {0, 1}) {
    const int reach = static_cast<int>(once.options.reach_mm / spacing[a]);
    EXPECT_LE(patch.position.box.size[a], pit.size[a] + 2 * reach) << a;
  }
  EXPECT_GE(patch.position.box.size[2] * spacing[2], pit.size[2] * spacing[2] + 0.9 * once.options.reach_mm);
}

TEST(Surfaces, AreRebuiltWhereTissueGrowsBeyondTheirExtent) {
  std::mt19937 random(8);
  const test::RandomBall ball(4, kClinicalSpacings[1], random);
  const PreparedSurface old = prepared_surfaces(ball.labels);
  auto labels = ball.labels;
  const auto& extent = old.intermediates.extent;
  const int top = extent.first[2] + extent.size[2] - 1;
  // cutting off one side stays within the extent
  const VoxelBox dirty{{0, 0, top}, {100, 100, 1}};
  for (int j = 0; j < labels.geometry().dims[1]; ++j) {
    for (int i = 0; i < labels.geometry().dims[0]; ++i) labels.at(i, j, top) = 0;
  }
  EXPECT_TRUE(prepare_patch(old, *label_bricks(labels), dirty).is_applicable);

  // no change: an empty patch
  const SurfacePatch none = prepare_patch(old, *label_bricks(ball.labels), dirty);
  EXPECT_TRUE(none.is_applicable);
  EXPECT_TRUE(none.position.values.empty());

  // outside the extent
  ASSERT_GT(extent.first[0], 0);
  labels = ball.labels;
  labels.at(extent.first[0] - 1, extent.first[1] + 3, extent.first[2] + 3) = kTissue;
  const VoxelBox beyond{{0, 0, 0}, labels.geometry().dims};
  EXPECT_FALSE(prepare_patch(old, *label_bricks(labels), beyond).is_applicable);
  const auto again = update_surface(old, *label_bricks(labels), beyond);
  ASSERT_TRUE(again.ok());
  expect_same(*again, prepared_surfaces(labels));

  // all removed
  EXPECT_FALSE(
      update_surface(old, *label_bricks(Volume<LabelId>(labels.geometry())), {{0, 0, 0}, {100, 100, 100}})
          .ok());
}

// ---- strays

TEST(Surfaces, ReportStraysAndDropThemOnRequest) {
  std::mt19937 random(9);
  test::RandomBall ball(6, {0.5, 0.5, 1}, random);
  const auto clean = prepared_surfaces(ball.labels);
  ball.labels.at(0, 0, 0) = kTissue;
  ball.labels.at(1, 1, 1) = kTissue;  // connected by a corner
  ball.labels.at(0, 5, 0) = kTissue;

  const PreparedSurface stored = prepared_surfaces(ball.labels);
  EXPECT_EQ(stored.components, 3);
  ASSERT_EQ(stored.strays.size(), 2u);
  EXPECT_EQ(stored.strays[0].voxels, 1u);
  EXPECT_EQ(stored.strays[0].box, (VoxelBox{{0, 5, 0}, {1, 1, 1}}));
  EXPECT_EQ(stored.strays[1].voxels, 2u);
  EXPECT_DOUBLE_EQ(stored.strays[1].volume_mm3, 0.5);
  EXPECT_EQ(stored.strays[1].box, (VoxelBox{{0, 0, 0}, {2, 2, 2}}));
  EXPECT_LT((stored.strays[1].centroid.eigen() - Eigen::Vector3d(0.25, 0.25, 0.5)).norm(), 1e-12);
  EXPECT_FALSE(stored.strays[1].dropped);
  expect_sides_preserved(stored, ball.labels);
  EXPECT_NEAR(stored.volume_mm3, clean.volume_mm3 + 0.75, 1e-9);

  PreparedSurface dropped = prepared_surfaces(ball.labels, {.drop_below_mm3 = 1});
  EXPECT_TRUE(dropped.strays[0].dropped && dropped.strays[1].dropped);
  expect_same(dropped, clean);
  EXPECT_FALSE(prepare_patch(dropped, *label_bricks(ball.labels), {{0, 0, 0}, {1, 1, 1}}).is_applicable);
}

// ---- bad input

TEST(Surfaces, RejectInvalidOptions) {
  const Volume<LabelId> labels(test::surface_grid({4, 4, 4}, {1, 1, 1}), kTissue);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const SurfaceOptions& bad :
       {SurfaceOptions{.reach_mm = 0.5}, SurfaceOptions{.reach_mm = 15.1}, SurfaceOptions{.reach_mm = nan},
        SurfaceOptions{.position_sigma_mm = -1}, SurfaceOptions{.normal_sigma_mm = 0},
        SurfaceOptions{.stray_below_mm3 = -1}, SurfaceOptions{.drop_below_mm3 = nan},
        SurfaceOptions{.drop_below_mm3 = 100}, SurfaceOptions{.threads = -1}}) {
    EXPECT_FALSE(prepare_surfaces(*label_bricks(labels), {kTissue}, bad).ok());
  }
  EXPECT_FALSE(prepare_surfaces(*label_bricks(labels), {0}, {}).ok());
  EXPECT_FALSE(prepare_surfaces(*label_bricks(labels), {kTissue, 3}, {}).ok());
  EXPECT_TRUE(prepare_surfaces(*label_bricks(labels), {}, {}).ok());
  // a structure that fills its volume ends at the volume's border
  const PreparedSurface full = prepared_surfaces(labels);
  EXPECT_LT(full.surface.distance_mm({1.5, 1.5, 1.5}), 0);
  EXPECT_GT(full.surface.distance_mm({1.5, 1.5, -1}), 0);
}

TEST(Surfaces, ReportProgressAndStop) {
  std::mt19937 random(10);
  const test::RandomBall ball(6, kClinicalSpacings[1], random);
  std::vector<double> shown;
  ASSERT_TRUE(prepare_surfaces(*label_bricks(ball.labels), {kTissue}, {},
                               Progress([&](std::string_view, double f) { shown.push_back(f); }, nullptr))
                  .ok());
  EXPECT_TRUE(std::is_sorted(shown.begin(), shown.end()));
  EXPECT_DOUBLE_EQ(shown.back(), 1);
  const std::atomic<bool> stop{true};
  const auto stopped = prepare_surfaces(*label_bricks(ball.labels), {kTissue}, {}, Progress({}, &stop));
  ASSERT_FALSE(stopped.ok());
  EXPECT_EQ(stopped.error().kind, ErrorKind::kInterrupted);
}

}  // namespace
}  // namespace palpate
