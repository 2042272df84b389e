#include "palpate/tissue/removal.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "palpate/tissue/tissue_settings.h"
#include "tissue/test_surfaces.h"

namespace palpate {
namespace {

/// Row of balls that extends a burr's head beyond its first ball.
struct Row {
  double length_mm = 0, end_radius_mm = 0;
  Vector<Patient> spindle = {1, 0, 0};  ///< Initial axis of the tool
};
const Row kLyingCylinder{5, 2, {1, 0, 0}}, kStandingCylinder{5, 2, {0, 0, 1}};
const Row kLyingCone{5, 1.2, Vector<Patient>(5, 0, -0.8).normalized()};
const Row kStandingCone{5, 2.8, {0, 0, 1}};

/// A burr of 4 mm above a block of bone, moved by a hand that yields to no force.
class GuidedBurr {
 public:
  explicit GuidedBurr(double revolutions_per_s = 1000, const Row& row = {})
      : carved_(testing::surface_to_carve(16, Eigen::Vector3d::Constant(0.6), testing::slab(-10, 0, 8))) {
    burr_.radius_mm = 2;
    burr_.revolutions_per_s = revolutions_per_s;
    burr_.axis = spindle_ = row.spindle;
    burr_.length_mm = row.length_mm;
    burr_.end_radius_mm = row.end_radius_mm;
    surfaces_[0].surface = carved_.surface();
    surfaces_[0].stiffness_N_per_mm = 2;
    surfaces_[0].cutting_energy_mJ_per_mm3 = 100;
    options_.friction = false;
  }

  ToolPose pose() const { return ToolPose(tip_, attitude_); }
  /// Moves linearly from the last tip.
  ProxyResult lead_to(const Point<Patient>& to, int ticks) { return lead_to(to, attitude_, ticks); }
  /// Moves and rotates linearly.
  ProxyResult lead_to(const Point<Patient>& to, const Eigen::Quaterniond& attitude, int ticks) {
    const Vector<Patient> step = (to - tip_) / ticks;
    const Eigen::Quaterniond from = attitude_;
    ProxyResult result;
    for (int n = 0; n < ticks; ++n) {
      tip_ += step;
      if (attitude.coeffs() != from.coeffs()) {
        attitude_ = from.slerp((n + 1.0) / ticks, attitude);
        burr_.axis = Vector<Patient>(attitude_ * spindle_.eigen());
      }
      result = advance_burr(surfaces_, burr_, pose(), proxy_, state_, options_);
      if (state_.removed_mm3 > 0) {
        EXPECT_LE(state_.removed_mm3 * surfaces_[0].cutting_energy_mJ_per_mm3, state_.work_mJ + 1e-9);
      }
    }
    return result;
  }
  void carve() {
    const std::uint64_t count = finished_sweeps(state_);
    carved_ = carved_.with(state_.pending().first(count - state_.first_sweep));
    for (ContactSurface& surface : surfaces_) {
      surface.surface = carved_.surface();
      surface.original_surface = carved_.original();
      surface.clearance_error_mm = carved_.clearance_error_mm();
    }
    rebase_burr(surfaces_, burr_, pose(), count, proxy_, state_);
    const ToolPart head = burr_.head(state_.inset_mm);
    std::vector<SurfaceCorrespondence> before;
    for (std::int16_t n = 0; n < static_cast<std::int16_t>(surfaces_.size()); ++n)
      before.push_back({n, false});
    transfer_proxy(surfaces_, {&head, 1}, pose(), before, proxy_);
  }
  /// Adds a softer adjacent structure, so that the bone contributes its stiffness in two layers.
  void in_two_layers() {
    surfaces_[0].layer = 1;
    surfaces_[0].lower_N_per_mm = 0.5;
    ContactSurface outer = surfaces_[0];
    outer.structure = outer.layer = 0;
    outer.lower_N_per_mm = 0;
    outer.upper_N_per_mm = 0.5;
    surfaces_.push_back(outer);
  }

  CarvedSurface carved_;
  std::vector<ContactSurface> surfaces_{1};
  Burr burr_;
  BurrState state_;
  ProxyState proxy_;
  ProxyOptions options_;
  Point<Patient> tip_{0, 0, 3};
  Eigen::Quaterniond attitude_ = Eigen::Quaterniond::Identity();
  Vector<Patient> spindle_;  // without rotation
};

TEST(Removal, StoppedBurrEqualsABall) {
  GuidedBurr off(0);
  ProxyState ball;
  const ToolPart part{Vector<Patient>(), 2};
  off.lead_to(Point<Patient>(0, 0, 2.5), 1);
  (void)advance_proxy(off.surfaces_, {&part, 1}, ToolPose(off.tip_), ball, off.options_);
  for (int n = 1; n <= 200; ++n) {
    const Point<Patient> tip(0.02 * n, 0.01 * n, 2.5 - 0.01 * n);
    const ProxyResult is = off.lead_to(tip, 1);
    const ProxyResult expected =
        advance_proxy(off.surfaces_, {&part, 1}, ToolPose(off.tip_), ball, off.options_);
    ASSERT_EQ(is.force_N, expected.force_N);
    ASSERT_EQ(off.proxy_.position, ball.position);
  }
  EXPECT_GT(ball.contact_count, 0);
  EXPECT_EQ(off.state_.removed_mm3, 0);
  EXPECT_TRUE(off.state_.pending().empty());
}

TEST(Removal, UncuttableMaterialIsNotCut) {
  GuidedBurr burr;
  burr.surfaces_[0].cutting_energy_mJ_per_mm3 = std::numeric_limits<double>::infinity();
  burr.lead_to(Point<Patient>(0, 0, 1), 50);
  EXPECT_EQ(burr.state_.removed_mm3, 0);
  EXPECT_TRUE(burr.state_.pending().empty());
  EXPECT_NEAR(burr.proxy_.position.z(), 2, 0.06);
}

TEST(Removal, BurrAdvancesAndForceDropsInTheSameTick) {
  GuidedBurr burr, ball(0);
  burr.lead_to(Point<Patient>(0, 0, 1.5), 50);
  ball.lead_to(Point<Patient>(0, 0, 1.5), 50);
  EXPECT_NEAR(ball.lead_to(ball.tip_, 1).force_N.z(), 1, 0.05);
  double last_N = burr.lead_to(burr.tip_, 1).force_N.z();
  double last_mm = burr.proxy_.position.z();
  for (int n = 0; n < 20; ++n) {
    const double force_N = burr.lead_to(burr.tip_, 1).force_N.z();
    EXPECT_LT(force_N, last_N);
    // spring force at the proxy's current position
    EXPECT_NEAR(last_N - force_N, 2 * (last_mm - burr.proxy_.position.z()), 1e-6);
    last_N = force_N;
    last_mm = burr.proxy_.position.z();
  }
  EXPECT_GT(burr.state_.removed_mm3, 0.1);
}

TEST(Removal, LayersMoveAsOneBurr) {
  GuidedBurr one, two;
  two.in_two_layers();
  for (int n = 0; n < 40; ++n) {
    // deeper than it can advance at once, carved from time to time
    const Point<Patient> tip(0.02 * n, 0, 1.5 - 0.04 * n);
    const ProxyResult in_one = one.lead_to(tip, 20), in_two = two.lead_to(tip, 20);
    one.carve();
    two.carve();
    EXPECT_NEAR(in_two.force_N.z(), in_one.force_N.z(), 0.02) << n;
    EXPECT_NEAR(in_two.force_N.norm(), 2 * (two.proxy_.layer(1).position - tip).norm(), 0.02) << n;
    EXPECT_LT((two.proxy_.layer(0).position - two.proxy_.layer(1).position).norm(), 0.01) << n;
    EXPECT_NEAR(in_two.stored_mJ, 0.25 * in_two.force_N.squared_norm(), 1e-3) << n;
  }
  EXPECT_GT(one.state_.removed_mm3, 3);
  EXPECT_NEAR(two.state_.removed_mm3, one.state_.removed_mm3, 0.02 * one.state_.removed_mm3);
}

TEST(Removal, StoppedBurrLeavesByItsEntryPath) {
  GuidedBurr burr;
  burr.lead_to(Point<Patient>(0, 0, 1.9), 20);
  const Point<Patient> in(1.3, 0.8, -3);
  const Vector<Patient> displacement = in - burr.tip_;
  const Point<Patient> from = burr.tip_;
  for (int n = 1; n <= 100; ++n) {
    burr.lead_to(from + displacement * (0.01 * n), 20);
    burr.carve();
  }
  ASSERT_LT((burr.proxy_.position - in).norm(), 0.4);
  EXPECT_GT(burr.carved_.clearance_error_mm(), 0.02);
  EXPECT_LT(burr.carved_.clearance_error_mm(), 0.6) << "a voxel";

  burr.burr_.revolutions_per_s = 0;
  const double removed_mm3 = burr.state_.removed_mm3;
  for (int n = 99; n >= 0; --n) {
    const ProxyResult result = burr.lead_to(from + displacement * (0.01 * n), 10);
    // no longer pressed into the bottom
    if (n < 90) {
      EXPECT_LT(result.force_N.norm(), 0.2) << n;
    }
  }
  EXPECT_EQ(burr.state_.removed_mm3, removed_mm3);
  // outside the hole it is a full ball again
  burr.lead_to(Point<Patient>(-6, 0, 2.5), 100);
  burr.lead_to(Point<Patient>(-6, 0, 1.5), 100);
  EXPECT_NEAR(burr.proxy_.position.z(), 2, 0.06);
}

TEST(Removal, ProtectedStructureIsReachedButNotCut) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  // a nerve of 3 mm diameter, 2.5 mm below the bone's surface
  const auto nerve = [](const Eigen::Vector3d& p) { return std::hypot(p.x(), p.z() + 4) - 1.5; };
  GuidedBurr burr;
  const ProtectedStructure structure{2, testing::surface_to_carve(16, Eigen::Vector3d::Constant(0.6), nerve),
                                     true};
  burr.burr_.protected_structures = {&structure, 1};
  burr.carved_ = CarvedSurface(burr.carved_.original(), {structure.surface});
  std::uniform_real_distribution<double> lateral(-4, 4), depth(-8, 0);
  double nearest_mm = 10;
  for (int stroke = 0; stroke < 40; ++stroke) {
    burr.lead_to(Point<Patient>(lateral(random), lateral(random), 2.2), 100);
    const Point<Patient> from = burr.tip_;
    // with up to 10 N, towards it and next to it
    const Vector<Patient> displacement =
        Point<Patient>(lateral(random), lateral(random), depth(random)) - from;
    for (int n = 1; n <= 20; ++n) {
      for (int tick = 1; tick <= 20; ++tick) {
        burr.lead_to(from + displacement * ((n - 1 + 0.05 * tick) / 20), 1);
        const double gap_mm = structure.surface->distance_mm(burr.proxy_.position) - burr.burr_.radius_mm;
        ASSERT_GT(gap_mm, -0.01) << stroke;
        nearest_mm = std::min(nearest_mm, gap_mm);
      }
      burr.carve();
      ASSERT_TRUE(burr.proxy_.coupled);
    }
  }
  EXPECT_LT(nearest_mm, 0.01) << "it was met";
  EXPECT_GT(burr.state_.removed_mm3, 50);
  // nothing of it is removed, while material directly above is
  int above = 0;
  for (double x = -4; x <= 4; x += 0.1)
    for (double y = -3; y <= 3; y += 0.5)
      for (double z = -6; z <= -0.3; z += 0.1) {
        const double is_mm = burr.carved_.surface()->distance_mm(Point<Patient>(x, y, z));
        const double from_nerve_mm = nerve(Eigen::Vector3d(x, y, z));
        if (from_nerve_mm < -0.05) {
          ASSERT_LT(is_mm, 0) << x << " " << y << " " << z;
        }
        if (is_mm > 0 && from_nerve_mm < 0.5) ++above;
      }
  EXPECT_GT(above, 20);
}

TEST(Removal, StoppedCylindricalHeadEqualsACapsule) {
  for (const Row& row : {kLyingCylinder, kStandingCylinder, kLyingCone, kStandingCone}) {
    GuidedBurr off(0, row);
    ProxyState head;
    off.lead_to(Point<Patient>(0, 0, 2.6), 1);
    (void)advance_proxy(off.surfaces_, std::array{off.burr_.head(0)}, off.pose(), head, off.options_);
    for (int n = 1; n <= 100; ++n) {
      const Eigen::Quaterniond turned(Eigen::AngleAxisd(0.002 * n, Eigen::Vector3d(1, 2, 3).normalized()));
      const Point<Patient> tip(0.02 * n, 0.01 * n, 2.6 - 0.01 * n);
      const ProxyResult is = off.lead_to(tip, turned, 1);
      const ProxyResult expected =
          advance_proxy(off.surfaces_, std::array{off.burr_.head(0)}, off.pose(), head, off.options_);
      ASSERT_EQ(is.force_N, expected.force_N);
      ASSERT_EQ(off.proxy_.position, head.position);
    }
    EXPECT_GT(head.contact_count, 0);
    EXPECT_EQ(off.state_.removed_mm3, 0);
  }
}

// volume swept from the block, by sampling a lattice of points not aligned with its planes
double swept_mm3(const Surface& block, const std::vector<SweptShape>& shapes) {
  constexpr double kCell_mm = 0.2;
  Eigen::Array3d low = Eigen::Array3d::Constant(1e9), high = -low;
  for (const SweptShape& shape : shapes) {
    low = low.min(shape.low() - shape.max_radius_mm());
    high = high.max(shape.high() + shape.max_radius_mm());
  }
  int used = 0;
  for (double z = low[2]; z < std::min(high[2], 0.1); z += kCell_mm)
    for (double y = low[1]; y < high[1]; y += kCell_mm)
      for (double x = low[0]; x < high[0]; x += kCell_mm) {
        const Point<Patient> at(x, y, z);
        used += block.distance_mm(at) < 0 &&
                std::any_of(shapes.begin(), shapes.end(),
                            [&](const auto& shape) { return shape.depth_mm(at) > 0; });
      }
  return used * kCell_mm * kCell_mm * kCell_mm;
}

// motion of a head, carved all along, and its result
struct GuidedPath {
  const char* name;
  Row row;
  Vector<Patient> along;  // from above the block
  double turn_rad = 0;    // about y, during the motion
};

TEST(Removal, RemovedVolumeMatchesTheEnergyBalance) {
  const GuidedPath paths[] = {{"cylinder, milling sideways", kLyingCylinder, {0, 3, -2}},
                              {"cylinder, drilling", kStandingCylinder, {0, 0, -3}},
                              {"cylinder, turning", kLyingCylinder, {0, 0, -1.5}, 0.3},
                              {"cone, pressed sideways", kLyingCone, {0, 0, -2}},
                              {"cone, drilling and turning", kStandingCone, {1, 0, -3}, 0.3}};
  for (const GuidedPath& guided : paths) {
    SCOPED_TRACE(guided.name);
    GuidedBurr burr(1000, guided.row);
    burr.lead_to(Point<Patient>(-2, -2, 2.05), 50);
    const Point<Patient> from = burr.tip_;
    std::vector<SweptShape> shapes;
    constexpr int kVersions = 30;
    for (int n = 1; n <= kVersions; ++n) {
      const double part = static_cast<double>(n) / kVersions;
      const Eigen::Quaterniond turned(Eigen::AngleAxisd(guided.turn_rad * part, Eigen::Vector3d::UnitY()));
      burr.lead_to(from + guided.along * part, turned, 20);
      for (const Sweep& sweep : finished_from(burr.state_, burr.state_.first_sweep))
        shapes.emplace_back(sweep);
      burr.carve();
      ASSERT_TRUE(burr.proxy_.coupled) << n;
    }
    for (const Sweep& sweep : burr.state_.pending()) shapes.emplace_back(sweep);
    const double swept = swept_mm3(*burr.carved_.original(), shapes);
    // material that is only grazed counts little
    EXPECT_NEAR(burr.state_.removed_mm3 / swept, 1, 0.1);
    EXPECT_GT(swept, 10);
  }
}

TEST(Removal, RotatingHeadPathIsSwept) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  std::uniform_real_distribution<double> about(-1, 1), unit(0, 1);
  for (const Row& row : {kLyingCylinder, kStandingCone}) {
    GuidedBurr burr(1000, row);
    // soft enough for it to follow
    burr.surfaces_[0].cutting_energy_mJ_per_mm3 = 5;
    burr.lead_to(Point<Patient>(-2, 0, 1.9), 50);
    std::vector<Point<Patient>> been;
    std::vector<SweptShape> shapes;
    for (int leg = 0; leg < 12; ++leg) {
      const Eigen::Vector3d axis(about(random), about(random), about(random));
      const Eigen::Quaterniond aim = burr.attitude_ * Eigen::AngleAxisd(0.15, axis.normalized());
      const Vector<Patient> displacement(0.5 * about(random), 0.5 * about(random), -0.2);
      const Point<Patient> from = burr.tip_;
      const Eigen::Quaterniond was = burr.attitude_;
      for (int n = 1; n <= 20; ++n) {
        burr.lead_to(from + displacement * (0.05 * n), was.slerp(0.05 * n, aim), 1);
        const ToolPart head = burr.burr_.head(0);
        const ToolPart part = RotatedTool({&head, 1}, burr.attitude_, burr.proxy_.attitude).parts()[0];
        for (int m = 0; m < 40; ++m) {
          const double fraction = unit(random);
          const Vector<Patient> out(about(random), about(random), about(random));
          // almost on its outline
          const Point<Patient> at = burr.proxy_.position + part.axis_mm * fraction +
                                    out.normalized() * (part.radius_at_mm(fraction) - 0.02);
          if (burr.carved_.original()->distance_mm(at) < -0.02) been.push_back(at);
        }
      }
      for (const Sweep& sweep : finished_from(burr.state_, burr.state_.first_sweep))
        shapes.emplace_back(sweep);
      burr.carve();
      ASSERT_TRUE(burr.proxy_.coupled) << leg;
    }
    for (const Sweep& sweep : burr.state_.pending()) shapes.emplace_back(sweep);
    int lost = 0;
    for (const Point<Patient>& at : been)
      lost += std::none_of(shapes.begin(), shapes.end(),
                           [&](const SweptShape& shape) { return shape.depth_mm(at) > 0; });
    EXPECT_EQ(lost, 0);
    EXPECT_GT(been.size(), 400u);
  }
}

TEST(Removal, CylinderDoesNotCutALateralProtectedStructure) {
  const unsigned seed = test::test_seed();
  std::mt19937 random(seed);
  SCOPED_TRACE(seed);
  // a nerve of 3 mm diameter that descends half a millimetre beside the head
  const auto nerve = [](const Eigen::Vector3d& p) { return std::hypot(p.x() - 4, p.y()) - 1.5; };
  GuidedBurr burr(1000, kStandingCylinder);
  const ProtectedStructure structure{2, testing::surface_to_carve(16, Eigen::Vector3d::Constant(0.6), nerve),
                                     true};
  burr.burr_.protected_structures = {&structure, 1};
  burr.carved_ = CarvedSurface(burr.carved_.original(), {structure.surface});
  std::uniform_real_distribution<double> about(-1, 1);
  double nearest_mm = 10, deepest_mm = 0;
  const auto lead = [&](const Vector<Patient>& aim_mm, const Eigen::Quaterniond& aim) {
    const Point<Patient> from = burr.tip_;
    const Eigen::Quaterniond was = burr.attitude_;
    for (int n = 1; n <= 10; ++n) {
      for (int tick = 1; tick <= 20; ++tick) {
        const double fraction = (n - 1 + 0.05 * tick) / 10;
        burr.lead_to(from + aim_mm * fraction, was.slerp(fraction, aim), 1);
        const ToolPart head = burr.burr_.head(0);
        const ToolPart part = RotatedTool({&head, 1}, burr.attitude_, burr.proxy_.attitude).parts()[0];
        const double gap_mm =
            nearest_part(*structure.surface, part, burr.proxy_.position).distance_mm - burr.burr_.radius_mm;
        nearest_mm = std::min(nearest_mm, gap_mm);
        deepest_mm = std::max(deepest_mm, -gap_mm);
      }
      burr.carve();
      ASSERT_TRUE(burr.proxy_.coupled);
    }
  };
  lead(Vector<Patient>(0, 0, -7), burr.attitude_);
  for (int stroke = 0; stroke < 25; ++stroke) {
    // with 5 N at the proxy, and rotated as a hand would
    const Vector<Patient> displacement =
        Vector<Patient>(about(random) + 0.5, about(random), 0.5 * about(random)).normalized() * 2.5;
    const Eigen::Vector3d axis(about(random), about(random), about(random));
    lead(burr.proxy_.position + displacement - burr.tip_,
         Eigen::Quaterniond(Eigen::AngleAxisd(0.2 * about(random), axis.normalized())));
  }
  EXPECT_LT(nearest_mm, 0.01) << "it was met";
  EXPECT_LT(deepest_mm, 0.01);
  EXPECT_GT(burr.state_.removed_mm3, 50);
  int beside = 0;
  for (double x = 0; x <= 8; x += 0.1)
    for (double y = -4; y <= 4; y += 0.2)
      for (double z = -8; z <= -0.3; z += 0.2) {
        const double is_mm = burr.carved_.surface()->distance_mm(Point<Patient>(x, y, z));
        const double from_nerve_mm = nerve(Eigen::Vector3d(x, y, z));
        if (from_nerve_mm < -0.05) {
          ASSERT_LT(is_mm, 0) << x << " " << y << " " << z;
        }
        if (is_mm > 0 && from_nerve_mm < 0.5) ++beside;
      }
  EXPECT_GT(beside, 20);
}

TEST(Removal, RimOfAGrooveIsCut) {
  // moved along an existing groove, whose rim it meets from the side
  GuidedBurr burr;
  for (ContactSurface& surface : burr.surfaces_) surface.cutting_energy_mJ_per_mm3 = 2;
  for (const double y : {-1.0, -0.5, 0.0, 0.5}) {
    burr.lead_to(Point<Patient>(-2.5, y, 2.2), 50);
    for (const Point<Patient>& to : {Point<Patient>(-2.5, y, 0.5), Point<Patient>(2.5, y, 0.5)}) {
      const Point<Patient> from = burr.tip_;
      for (int n = 1; n <= 20; ++n) {
        burr.lead_to(from + (to - from) * (0.05 * n), 20);
        burr.carve();
      }
      EXPECT_LT((burr.proxy_.position - to).norm(), 0.1) << y;
    }
    burr.lead_to(burr.tip_ + Vector<Patient>(0, 0, 2), 50);
  }
}

TEST(Removal, PendingSweepsAreBounded) {
  // surfaces that are never rebuilt, material soft enough for a long path, on a spiral
  GuidedBurr burr;
  burr.surfaces_[0].cutting_energy_mJ_per_mm3 = 5;
  burr.lead_to(Point<Patient>(0, 0, 1.5), 100);
  for (int n = 0; n < 400; ++n)
    burr.lead_to(Point<Patient>(0.01 * n * std::sin(0.1 * n), 0.01 * n * std::cos(0.1 * n), 1 - 0.02 * n), 5);
  EXPECT_TRUE(burr.state_.sweeps_full);
  EXPECT_LE(burr.state_.pending().size(), burr.state_.sweep.size());
  EXPECT_LE(burr.state_.inset_mm, 1.6 + 1e-9);
  const double removed_mm3 = burr.state_.removed_mm3;
  burr.lead_to(Point<Patient>(0, 0, -8), 100);
  EXPECT_EQ(burr.state_.removed_mm3, removed_mm3) << "no more than is remembered";
  burr.carve();
  EXPECT_FALSE(burr.state_.sweeps_full);
  EXPECT_TRUE(burr.proxy_.coupled);
  burr.lead_to(Point<Patient>(0, 0, -9), 100);
  EXPECT_GT(burr.state_.removed_mm3, removed_mm3);
}

TEST(Removal, SweepsAddedDuringCarvingArePreserved) {
  GuidedBurr burr;
  burr.lead_to(Point<Patient>(0, 0, 1.5), 100);
  const std::uint64_t count = finished_sweeps(burr.state_);
  ASSERT_GT(count, 0u);
  const Sweep last = burr.state_.pending()[static_cast<std::size_t>(count) - 1];
  burr.lead_to(Point<Patient>(1, 0, 1.3), 100);
  EXPECT_GT(finished_sweeps(burr.state_), count);
  EXPECT_EQ(burr.state_.pending()[static_cast<std::size_t>(count) - 1].to, last.to)
      << "what is being carved grows no more";
  const Sweep next = burr.state_.pending()[static_cast<std::size_t>(count)];
  const std::uint64_t all = finished_sweeps(burr.state_);
  rebase_burr(burr.surfaces_, burr.burr_, burr.pose(), count, burr.proxy_, burr.state_);
  EXPECT_EQ(burr.state_.first_sweep, count);
  EXPECT_EQ(burr.state_.pending().front().from, next.from);
  EXPECT_EQ(finished_sweeps(burr.state_), all);
  // repeating the call loses nothing
  rebase_burr(burr.surfaces_, burr.burr_, burr.pose(), count, burr.proxy_, burr.state_);
  EXPECT_EQ(finished_sweeps(burr.state_), all);
}

TEST(Removal, DebtIsWorkedOffBeforeTheBurrAdvances) {
  GuidedBurr burr;
  burr.lead_to(Point<Patient>(0, 0, 1.5), 50);
  const double mJ_per_mm3 = burr.surfaces_[0].cutting_energy_mJ_per_mm3;
  const std::uint64_t count = finished_sweeps(burr.state_);
  ASSERT_GT(count, 0u);
  double paid_mm3 = 0;
  for (std::uint64_t n = 0; n < count; ++n) paid_mm3 += burr.state_.spent_mJ[n][kThick] / mJ_per_mm3;
  EXPECT_GT(paid_mm3, 0);
  EXPECT_LE(paid_mm3, burr.state_.removed_mm3);
  // within the tolerance of the account nothing is charged
  CarvedMaterial carved{count, {paid_mm3 + 0.99 * kCuttingSettings.thick_uncharged_mm3, 0}, {}};
  carved.energy_mJ[kThick] = carved.volume_mm3[kThick] * mJ_per_mm3;
  BurrState tolerated = burr.state_;
  settle_burr(carved, tolerated);
  EXPECT_EQ(tolerated.debt_mJ, 0);
  // thin bone removed with it is charged in full
  constexpr double kThin_mm3 = 0.5;
  carved.volume_mm3[kThin] = kThin_mm3;
  carved.energy_mJ[kThin] = kThin_mm3 * mJ_per_mm3;
  settle_burr(carved, burr.state_);
  EXPECT_NEAR(burr.state_.debt_mJ, kThin_mm3 * mJ_per_mm3, 1e-9);
  settle_burr(carved, burr.state_);
  EXPECT_NEAR(burr.state_.debt_mJ, kThin_mm3 * mJ_per_mm3, 1e-9) << "settled twice";

  const double work_mJ = burr.state_.work_mJ, removed_mm3 = burr.state_.removed_mm3;
  const Point<Patient> at = burr.proxy_.position;
  int ticks = 0;
  for (; burr.state_.debt_mJ > 0 && ticks < 1000; ++ticks) {
    EXPECT_LT((burr.proxy_.position - at).norm(), 1e-3) << ticks;
    burr.lead_to(burr.tip_, 1);
  }
  EXPECT_EQ(burr.state_.debt_mJ, 0);
  EXPECT_GT(ticks, 5);
  EXPECT_GE(burr.state_.work_mJ - work_mJ, kThin_mm3 * mJ_per_mm3);
  EXPECT_GE(burr.state_.removed_mm3 - removed_mm3, kThin_mm3 - 1e-9);
  burr.lead_to(burr.tip_, 50);
  EXPECT_LT(burr.proxy_.position.z(), at.z() - 0.01) << "then it cuts again";
}

TEST(Removal, SlowSweepIsCompletedWithinItsTimeLimit) {
  GuidedBurr burr;
  burr.lead_to(Point<Patient>(0, 0, 1.9), 100);
  std::uint64_t finished = finished_sweeps(burr.state_);
  ASSERT_GT(burr.state_.removed_mm3, 0);
  // with little pressure it sinks in by less than would start another sweep
  constexpr int kTicks = static_cast<int>(kCuttingSettings.max_sweep_s / 0.001);
  for (int n = 0; n < 5; ++n) {
    burr.lead_to(burr.tip_, kTicks + 1);
    EXPECT_GT(finished_sweeps(burr.state_), finished) << n;
    finished = finished_sweeps(burr.state_);
  }
}

}  // namespace
}  // namespace palpate
