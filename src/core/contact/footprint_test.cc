#include "contact/footprint.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

#include "base/test_seed.h"
#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/bonded_layer.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

const Vector<Patient> kUp(0, 0, 1);

// Hertz's law with E* = 1
double force_of(const Footprint& foot) {
  return 4.0 / 3 * std::sqrt(foot.radius_mm) * std::pow(foot.depth_mm, 1.5);
}
double energy_of(const Footprint& foot) {
  return 0.4 * force_of(foot) * foot.depth_mm;
}

TEST(Footprint, OfOnePointIsThatPoint) {
  const FootprintPoint point{{1, 2, 3}, 2.5, 0.7};
  const Footprint foot = footprint_of({&point, 1}, kUp);
  EXPECT_NEAR(foot.depth_mm, 0.7, 1e-12);
  EXPECT_NEAR(foot.radius_mm, 2.5, 1e-12);
  EXPECT_EQ(foot.interaction_per_mm, 0);
  EXPECT_NEAR(foot.stiffness_ratio, 1, 1e-12);
  EXPECT_NEAR((foot.arm_mm - Vector<Patient>(1, 2, 0.5)).norm(), 0, 1e-12);
}

TEST(Footprint, DistantPointsSuperpose) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> radius(0.5, 4), depth(1e-3, 5);
  for (int trial = 0; trial < 200; ++trial) {
    std::vector<FootprintPoint> points(1 + random() % kMaxFootprintPoints);
    double force = 0, energy = 0, slope = 0;
    for (std::size_t n = 0; n < points.size(); ++n) {
      points[n] = {Vector<Patient>(100.0 * static_cast<double>(n), 0, 0), radius(random), depth(random)};
      const double root = std::sqrt(points[n].radius_mm), d = points[n].depth_mm;
      force += 4.0 / 3 * root * std::pow(d, 1.5);
      energy += 8.0 / 15 * root * std::pow(d, 2.5);
      slope += 2 * root * std::sqrt(d);
    }
    const Footprint foot = footprint_of(points, kUp);
    EXPECT_NEAR(force_of(foot), force, 1e-9 * force);
    EXPECT_NEAR(energy_of(foot), energy, 1e-9 * energy);
    EXPECT_NEAR(1.5 * force_of(foot) / foot.depth_mm * foot.stiffness_ratio, slope, 1e-9 * slope);
  }
}

// Force on a half-space with E* = 1 (soft_contact_force's law), with the footprint's additional compliance.
double pressed_N(const Footprint& foot) {
  const ContactLaw tissue{foot.interaction_per_mm, {}, 1};
  return soft_contact_force(tissue, foot.depth_mm, foot.radius_mm).force_N;
}

// Comparison with a half-space solved with cells of 0.15 mm (bench/footprint_truth.py). A single sphere in
// place of the footprint is 16 to 44 % too soft for two spheres and 46 to 90 % for a shaft lying flat.
TEST(Footprint, MatchesTheHalfSpaceSolution) {
  struct TwoSpheres {
    double separation_mm, higher_mm, truth_N;
  };
  for (const auto& [separation_mm, higher_mm, truth_N] :
       {TwoSpheres{2, 0, 8.319}, {4, 0, 9.609}, {8, 0, 10.974}, {12, 0, 11.583}, {8, 1, 7.742}}) {
    const FootprintPoint points[2] = {{{0, 0, 0}, 3, 2}, {{separation_mm, 0, higher_mm}, 3, 2 - higher_mm}};
    EXPECT_NEAR(pressed_N(footprint_of(points, kUp)), truth_N, 0.03 * truth_N)
        << separation_mm << ", " << higher_mm;
  }
  const ContactSurface plane = testing::make_contact_surface(
      testing::cube_grid(45, {1, 1, 1}), [](const Eigen::Vector3d& p) { return p.z(); }, 12);
  const int edge_contact_front = 0;
  struct Shaft {
    double radius_mm, length_mm, deep_mm, truth_N;
  };
  for (const auto& [radius_mm, length_mm, deep_mm, truth_N] : {Shaft{2, 20, 0.3, 2.171},
                                                               {2, 20, 1, 8.687},
                                                               {2, 20, 2, 19.651},
                                                               {1, 20, 1, 7.785},
                                                               {5, 30, 2, 30.071},
                                                               {2, 5, 1, 3.939},
                                                               {1, 40, 1, 12.921}}) {
    const ToolPart shaft{{}, radius_mm, {length_mm, 0, 0}};
    std::vector<FootprintPoint> footprint_points(kMaxFootprintPoints);
    const std::size_t count =
        find_press_points({&plane, 1}, {&edge_contact_front, 1}, {&shaft, 1},
                          Point<Patient>(-20, 0, radius_mm - deep_mm), footprint_points);
    const double is_N = pressed_N(footprint_of(std::span(footprint_points).first(count), kUp));
    // where the contact is wider than the depth, the row resolves less of the area between its spheres
    const double largest = deep_mm < 0.2 * radius_mm ? 0.2 : 0.11;
    EXPECT_NEAR(is_N, truth_N, largest * truth_N) << radius_mm << ", " << length_mm << ", " << deep_mm;
  }
}

// Spheres farther apart than a layer is thick press as if each were alone, and close ones as on a half-space
// with the layer's base. The sphere that stands for both is blunter than each, so that the correction of a
// paraboloid to a sphere is smaller: up to a tenth of the force at a third of the radius.
TEST(Footprint, PressPointsOnALayerHaveTheirOwnBase) {
  const double modulus = 0.0125, thickness_mm = 3;
  const ContactLaw layer{layer_base_mm_per_N(thickness_mm, modulus, 0.45), {}, modulus};
  const double base_per_mm = -layer.surroundings_mm_per_N * modulus;
  const auto pressed = [&](double separation_mm) {
    const FootprintPoint points[2] = {{{0, 0, 0}, 3, 1}, {{separation_mm, 0, 0}, 3, 1}};
    const Footprint foot = footprint_of(points, kUp, base_per_mm);
    ContactLaw both = layer;
    both.surroundings_mm_per_N += foot.interaction_per_mm / modulus;
    return soft_contact_force(both, foot.depth_mm, foot.radius_mm).force_N;
  };
  const double alone_N = soft_contact_force(layer, 1, 3).force_N;
  EXPECT_NEAR(pressed(12) / (2 * alone_N), 1, 0.1);
  double before = pressed(3);
  for (double separation_mm = 3.01; separation_mm < 12; separation_mm += 0.01) {
    const double now = pressed(separation_mm);
    EXPECT_LT(std::abs(now - before), 0.01 * alone_N) << separation_mm;
    EXPECT_LE(now, 2 * alone_N * 1.1);
    before = now;
  }
  EXPECT_LT(pressed(3), 2.2 * alone_N);
}

// as a place passes through the surface, moves behind another place, or passes it
TEST(Footprint, IsContinuous) {
  constexpr int kSteps = 4000;
  for (const double lateral_mm : {0.0, 0.4, 1.0, 2.0, 6.0}) {
    SCOPED_TRACE(std::to_string(lateral_mm) + " mm aside");
    double last = 0;
    for (int n = 1; n <= kSteps; ++n) {
      const double depth = 4.0 * n / kSteps;
      const FootprintPoint points[2] = {{{0, 0, 0}, 2, 2}, {{lateral_mm, 0, 2 - depth}, 2, depth}};
      const double force = force_of(footprint_of(points, kUp));
      if (n > 1) {
        EXPECT_LT(std::abs(force - last), 0.01);
      }
      last = force;
    }
    // a single place, or two
    const double one = 4.0 / 3 * std::sqrt(2.0) * 8;
    EXPECT_NEAR(last, lateral_mm >= 2 ? one + 4.0 / 3 * std::sqrt(2.0) * std::pow(2, 1.5) : one,
                1e-9 + 0.3 * one);
    if (lateral_mm == 0) {
      EXPECT_NEAR(last, one, 1e-9);
    }
  }
}

// A shaft pushed in along its axis presses with its end only, at any depth; lying flat it presses with its
// whole length.
TEST(Footprint, ShaftPressesWithItsSupportedLength) {
  const ContactSurface plane = testing::make_contact_surface(
      testing::cube_grid(40, {1, 1, 1}), [](const Eigen::Vector3d& p) { return p.z(); }, 12);
  const int edge_contact_front = 0;
  const auto of = [&](const Eigen::Vector3d& along, double deep_mm) {
    const ToolPart shaft{{}, 2, Vector<Patient>(along)};
    std::vector<FootprintPoint> points(kMaxFootprintPoints);
    const std::size_t count = find_press_points({&plane, 1}, {&edge_contact_front, 1}, {&shaft, 1},
                                                Point<Patient>(0, 0, 2 - deep_mm), points);
    return footprint_of(std::span(points).first(count), kUp);
  };
  const double one = 4.0 / 3 * std::sqrt(2.0) * std::pow(8, 1.5);
  EXPECT_NEAR(force_of(of({0, 0, 20}, 8)), one, 1e-3 * one);
  const double lying = 4.0 / 3 * std::sqrt(2.0);
  EXPECT_NEAR(force_of(of({20, 0, 0}, 1)), 11 * lying, 0.01 * lying);
  // continuous in between
  double last = 0;
  for (int n = 0; n <= 900; ++n) {
    const double turn = n * 1e-3 * 1.7453292519943295;
    const double force = force_of(of({20 * std::sin(turn), 0, 20 * std::cos(turn)}, 1));
    if (n > 0) {
      EXPECT_LT(std::abs(force - last), 0.05 * 11 * lying) << n;
    }
    last = force;
  }
}

}  // namespace
}  // namespace palpate
