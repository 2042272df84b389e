#include "palpate/contact/soft_contact.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "base/test_seed.h"
#include "contact/sphere_law.h"
#include "contact/test_proxy_surfaces.h"
#include "palpate/base/cube_root.h"

namespace palpate {
namespace {

using test::test_seed;
using testing::cube_grid;
using testing::make_contact_surface;
using testing::ProxyRun;

constexpr double kModulus = 0.0125;  // E = 10 kPa, nu = 0.45

// ratio of the depth of a sphere to that of a paraboloid in a half-space (Sneddon 1965), by bisection for the
// contact's radius
double sphere_ratio(double force_N, double modulus, double radius_mm) {
  const double requested = force_N / (modulus * radius_mm * radius_mm);
  double low = 0, high = 1;
  for (int n = 0; n < 200; ++n) {
    const double a = 0.5 * (low + high);
    // the difference of two nearly equal terms where a is small
    const double force = a < 1e-3 ? 4.0 / 3 * a * a * a * (1 + 0.4 * a * a) : (a * a + 1) * std::atanh(a) - a;
    (force < requested ? low : high) = a;
  }
  const double hertz = std::cbrt(0.75 * requested);
  return low * std::atanh(low) / (hertz * hertz);
}

// depth at a force, as in docs/concepts/tissue.md, and dd/dF
double depth_mm(const ContactLaw& tissue, double force_N, double radius_mm) {
  return SphereLaw(tissue, radius_mm).at(std::cbrt(force_N)).mm;
}
double compliance_mm_per_N(const ContactLaw& tissue, double force_N, double radius_mm) {
  const double step = 1e-5 * force_N;
  return (depth_mm(tissue, force_N + step, radius_mm) - depth_mm(tissue, force_N - step, radius_mm)) /
         (2 * step);
}

// force by bisection, linear from where the compliance is first below the minimum
double slow_force_N(const ContactLaw& tissue, double depth, double radius_mm, double min_mm_per_N) {
  constexpr double kMin_N = 1e-7, kGrowth = 1.02;
  constexpr int kForces = 1400;
  double first_N = kMin_N;
  int step = 0;
  while (step < kForces && depth_mm(tissue, first_N, radius_mm) < depth &&
         compliance_mm_per_N(tissue, first_N, radius_mm) >= min_mm_per_N) {
    first_N *= kGrowth;
    ++step;
  }
  double low = step > 0 ? first_N / kGrowth : 0, high = first_N;
  if (compliance_mm_per_N(tissue, high, radius_mm) < min_mm_per_N) {
    for (int n = 0; n < 60; ++n) {
      const double midpoint = 0.5 * (low + high);
      (compliance_mm_per_N(tissue, midpoint, radius_mm) > min_mm_per_N ? low : high) = midpoint;
    }
    const double at_mm = depth_mm(tissue, low, radius_mm);
    if (depth >= at_mm) return low + (depth - at_mm) / min_mm_per_N;
    low = 0;
  }
  for (int n = 0; n < 60; ++n) {
    const double centre = 0.5 * (low + high);
    (depth_mm(tissue, centre, radius_mm) < depth ? low : high) = centre;
  }
  return low;
}

TEST(CubeRoot, IsOneOverTheWholeRange) {
  std::mt19937 random(test_seed());
  std::uniform_real_distribution<double> exponent(-200, 200);
  for (int n = 0; n < 100'000; ++n) {
    const double root = std::pow(10, exponent(random) / 3), x = root * root * root;
    ASSERT_NEAR(cube_root(x) / root, 1, 2e-15) << x;
  }
  EXPECT_EQ(cube_root(0), 0);
}

TEST(SoftContactForce, MatchesSneddonsSphereOnAHalfSpace) {
  const ContactLaw half_space{0, {}, kModulus};
  for (const double radius_mm : {0.5, 3.0, 8.0})
    for (const double depth : {0.01, 0.1, 0.5, 1.0, 2.0, 4.0}) {
      const SoftContactForce force = soft_contact_force(half_space, depth * radius_mm, radius_mm);
      const double hertz_N = 4.0 / 3 * kModulus * radius_mm * radius_mm * std::pow(depth, 1.5);
      const double depth_at =
          std::pow(force.force_N / hertz_N, 2.0 / 3) * sphere_ratio(force.force_N, kModulus, radius_mm);
      EXPECT_NEAR(depth_at, 1, 0.005) << depth;
      // small contacts are Hertz's
      if (depth == 0.01) {
        EXPECT_NEAR(force.force_N / hertz_N, 1, 0.005);
      }
      EXPECT_NEAR(force.stored_mJ / (0.4 * hertz_N * depth * radius_mm), 1, 0.01 + 0.12 * depth);
    }
  EXPECT_EQ(soft_contact_force(half_space, 0, 3).force_N, 0);
  EXPECT_EQ(soft_contact_force(half_space, -1, 3).force_N, 0);
  EXPECT_EQ(soft_contact_force(half_space, std::nan(""), 3).force_N, 0);
  // a point counts as a small sphere
  EXPECT_EQ(soft_contact_force(half_space, 1, 0).force_N,
            soft_contact_force(half_space, 1, kSoftTissueSettings.min_radius_mm).force_N);
}

TEST(SoftContactForce, MatchesAnExhaustiveSearchInForceSlopeAndWork) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 2000; ++n) {
    const double radius_mm = 0.5 + 7 * unit(random);
    ContactLaw tissue{0, {}, std::pow(10, 3 * unit(random) - 3)};
    // from stiff bone below to soft surroundings
    tissue.surroundings_mm_per_N = (2 * unit(random) - 0.8) / (2 * tissue.modulus_N_per_mm2);
    // also with C that increases the stiffness; softening only where the other terms are soft enough
    const double own = 1 / (tissue.modulus_N_per_mm2 * radius_mm);
    const double per_N = unit(random) * own / (tissue.modulus_N_per_mm2 * radius_mm * radius_mm);
    const double largest = unit(random) < 0.5 ? std::pow(10, 3 * unit(random) - 2) : 1e9;
    const double min_mm_per_N = std::max(1 / largest, kSoftTissueSettings.min_compliance_mm_per_N);
    if (n % 3 == 1) tissue.stiffening_mm_per_N2 = per_N;
    if (n % 3 == 2 && tissue.surroundings_mm_per_N > min_mm_per_N) tissue.stiffening_mm_per_N2 = -per_N;
    tissue.reference_force_N = 3 * unit(random) / own;
    const double depth = std::pow(10, 3 * unit(random) - 2);
    const SoftContactForce force = soft_contact_force(tissue, depth, radius_mm, largest);
    const double slow_N = slow_force_N(tissue, depth, radius_mm, min_mm_per_N);
    // the slope of the exhaustive search is a difference
    ASSERT_NEAR(force.force_N / slow_N, 1, 1e-5) << n;
    ASSERT_LE(force.tangent_N_per_mm, 1 / min_mm_per_N * (1 + 1e-9)) << n;
    const double step = 1e-4 * depth;
    const SoftContactForce less = soft_contact_force(tissue, depth - step, radius_mm, largest),
                           more = soft_contact_force(tissue, depth + step, radius_mm, largest);
    // a mean of the slopes in the interval, which has no kink
    const auto [least, greatest] =
        std::minmax({less.tangent_N_per_mm, force.tangent_N_per_mm, more.tangent_N_per_mm});
    const double slope = (more.force_N - less.force_N) / (2 * step);
    ASSERT_GT(slope, least * (1 - 2e-3)) << n;
    ASSERT_LT(slope, greatest * (1 + 2e-3)) << n;
    const double work_N = (more.stored_mJ - less.stored_mJ) / (2 * step);
    ASSERT_GT(work_N, less.force_N * (1 - 1e-6)) << n;
    ASSERT_LT(work_N, more.force_N * (1 + 1e-6)) << n;
    ASSERT_NEAR(work_N / force.force_N, 1, 5e-4) << n;
  }
}

TEST(SoftContactForce, OverASofteningHardInclusionGrowsBoundedlyWithDepth) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 300; ++n) {
    // B below 0, so that the law may exceed the stiffness limit, and may end
    ContactLaw tissue{-unit(random) / kModulus, {}, kModulus};
    tissue.stiffening_mm_per_N2 = -std::pow(10, 4 * unit(random) - 1);
    tissue.reference_force_N = unit(random);
    double before_N = 0;
    for (int step = 1; step < 400; ++step) {
      const SoftContactForce force = soft_contact_force(tissue, 0.01 * step, 3, 2);
      ASSERT_GT(force.force_N, before_N);
      ASSERT_LE(force.force_N - before_N, 0.01 * 2 * (1 + 1e-9));
      before_N = force.force_N;
    }
  }
}

TEST(SoftContactForce, TangentialForceIsTheEnergyGradientAlongTheSurface) {
  ContactLaw tissue{3, {-0.8, 0.3, 0}, kModulus};
  tissue.stiffening_mm_per_N2 = 12;
  tissue.stiffening_gradient = {2, -5, 0};
  constexpr double kDistance_mm = 1e-4;
  // above F1, where the C term is linear, and below
  for (int n = 0; n < 4; ++n) {
    tissue.reference_force_N = n < 2 ? 0.02 : 1;
    const int axis = n % 2;
    const SoftContactForce at = soft_contact_force(tissue, 3, 3);
    ASSERT_EQ(at.force_N > tissue.reference_force_N, n < 2);
    const auto stored_at = [&](double distance_mm) {
      ContactLaw there = tissue;
      there.surroundings_mm_per_N += distance_mm * tissue.gradient_per_N[axis];
      there.stiffening_mm_per_N2 += distance_mm * tissue.stiffening_gradient[axis];
      return soft_contact_force(there, 3, 3).stored_mJ;
    };
    const double lost = (stored_at(-kDistance_mm) - stored_at(kDistance_mm)) / (2 * kDistance_mm);
    EXPECT_NEAR(at.tangential_force_N[axis], lost, 1e-6 * at.force_N);
  }
}

TEST(SoftContactForce, IsMonotonicInDepth) {
  const ContactLaw stiff_below{-0.3 / kModulus, {}, kModulus};
  double before_N = 0;
  for (int n = 1; n < 3000; ++n) {
    const double force_N = soft_contact_force(stiff_below, 0.01 * n, 3, 2).force_N;
    EXPECT_GT(force_N, before_N);
    EXPECT_LE(force_N - before_N, 0.01 * 2 * (1 + 1e-9));
    before_N = force_N;
  }
}

ComplianceFrame frame_of(std::uint32_t number, double compliance, const Vector<Patient>& slope = {}) {
  ComplianceFrame frame;
  frame.number = number;
  frame.local_compliance[0] = {Point<Patient>(0, 0, 0), compliance, slope, kModulus, 3};
  frame.local_compliance[0].compute_surroundings();
  return frame;
}

TEST(SoftTissueHaptics, IsAHalfSpaceWithoutAFrame) {
  ComplianceState state;
  const ContactLaw tissue = blend_compliance(0, {}, {1, 2, 3}, kModulus, 0.001, state);
  EXPECT_EQ(tissue.surroundings_mm_per_N, 0);
  EXPECT_EQ(tissue.modulus_N_per_mm2, kModulus);
  EXPECT_EQ(tissue.gradient_per_N, Vector<Patient>());
}

TEST(SoftTissueHaptics, ExtrapolatesAFrameAlongTheSurfaceOverALimitedDistance) {
  const ComplianceFrame frame = frame_of(1, 20, {0.5, 0, 0});
  const double half_space = 0.6 / (3 * kModulus);
  const auto beyond_at = [&](double x) {
    ComplianceState state;
    return blend_compliance(1, frame.local_compliance[0], {x, 0, 0}, 1, 0.001, state);
  };
  EXPECT_NEAR(beyond_at(0).surroundings_mm_per_N, 20 - half_space, 1e-12);
  EXPECT_NEAR(beyond_at(2).surroundings_mm_per_N, 21 - half_space, 1e-12);
  EXPECT_EQ(beyond_at(2).gradient_per_N, frame.local_compliance[0].gradient_per_N);
  // where the extrapolation is clamped there is no tangential force either
  EXPECT_NEAR(beyond_at(200).surroundings_mm_per_N, 40 - half_space, 1e-12);
  EXPECT_NEAR(beyond_at(-200).surroundings_mm_per_N, 10 - half_space, 1e-12);
  EXPECT_EQ(beyond_at(200).gradient_per_N, Vector<Patient>());
}

TEST(SoftTissueHaptics, NewFrameBlendsInWithoutAForceStep) {
  ComplianceState state;
  const ComplianceFrame first = frame_of(1, 12), second = frame_of(2, 20), none{3, {}};
  const auto force_N = [&](const ComplianceFrame& frame) {
    return soft_contact_force(
               blend_compliance(frame.number, frame.local_compliance[0], {0, 0, 0}, kModulus, 0.001, state),
               4, 3)
        .force_N;
  };
  const double stiff_N = force_N(first);
  EXPECT_EQ(force_N(first), stiff_N);
  double before_N = stiff_N;
  for (int n = 0; n < 16; ++n) {
    const double now_N = force_N(second);
    EXPECT_LT(now_N, before_N);
    EXPECT_LT(before_N - now_N, 0.1 * stiff_N);
    before_N = now_N;
  }
  ComplianceState fresh;
  EXPECT_NEAR(
      before_N,
      soft_contact_force(blend_compliance(2, second.local_compliance[0], {}, kModulus, 0.001, fresh), 4, 3)
          .force_N,
      1e-12);
  // no frame known: back to a half-space, blended as slowly
  EXPECT_NEAR(force_N(none), before_N, 0.1 * before_N);
  // a tool that was away uses the newest frame at once
  state = {};
  EXPECT_NEAR(
      force_N(second),
      soft_contact_force(blend_compliance(2, second.local_compliance[0], {}, kModulus, 0.001, fresh), 4, 3)
          .force_N,
      1e-12);
}

TEST(SoftTissueHaptics, RemainingFrameNeverMakesTheModulusNegative) {
  // from a known soft spot to unknown tissue, first stiff and then, before the blending ends, soft
  ComplianceFrame known = frame_of(1, 16, {});
  known.local_compliance[0].modulus_N_per_mm2 = 0.01;
  ComplianceState state;
  blend_compliance(1, known.local_compliance[0], {}, 0.01, 0.001, state);
  blend_compliance(2, LocalCompliance{}, {}, 0.2, 0.001, state);
  for (int n = 0; n < 14; ++n) {
    const ContactLaw tissue = blend_compliance(2, LocalCompliance{}, {}, 0.03, 0.001, state);
    ASSERT_GT(tissue.modulus_N_per_mm2, 0) << n;
    ASSERT_LE(tissue.modulus_N_per_mm2, 0.03) << n;
    const SoftContactForce force = soft_contact_force(tissue, 2, 3);
    ASSERT_TRUE(std::isfinite(force.force_N) && force.force_N > 0 && force.tangent_N_per_mm > 0) << n;
  }
}

TEST(SoftTissueHaptics, NeoHookeanTermBlendsInWithoutAForceStep) {
  ComplianceFrame frame = frame_of(1, 12);
  const std::uint64_t linear = frame.hash();
  frame.local_compliance[0].stiffening_mm_per_N2 = 8;
  frame.local_compliance[0].stiffening_gradient = {1, 0, 0};
  ComplianceState state;
  // without reference_force_N there is no neo-Hookean term
  EXPECT_EQ(
      blend_compliance(1, frame.local_compliance[0], {0, 0, 0}, kModulus, 0.001, state).stiffening_mm_per_N2,
      0);
  EXPECT_EQ(frame.hash(), linear);
  frame.number = 2;
  frame.local_compliance[0].reference_force_N = 0.2;
  ComplianceFrame other = frame;
  other.local_compliance[0].stiffening_gradient = {0, 1, 0};
  EXPECT_NE(frame.hash(), other.hash());
  double before = 0;
  for (int n = 0; n < 15; ++n) {
    const ContactLaw tissue =
        blend_compliance(2, frame.local_compliance[0], {0, 0, 0}, kModulus, 0.001, state);
    EXPECT_GT(tissue.stiffening_mm_per_N2, before);
    EXPECT_LT(tissue.stiffening_mm_per_N2 - before, 0.1 * 8);
    before = tissue.stiffening_mm_per_N2;
  }
  for (const double x : {0.5, 100.0}) {
    ComplianceState fresh;
    const ContactLaw tissue =
        blend_compliance(2, frame.local_compliance[0], {x, 0, 0}, kModulus, 0.001, fresh);
    const double largest = kSoftTissueSettings.max_stiffening * 12 / 0.2;
    EXPECT_EQ(tissue.stiffening_mm_per_N2, std::min(8 + x, largest));
    EXPECT_EQ(tissue.stiffening_gradient,
              x < 1 ? frame.local_compliance[0].stiffening_gradient : Vector<Patient>());
  }
}

// deformable half-space below z = 0
ProxyRun on_soft_floor(double friction = 0) {
  ProxyRun run;
  run.surfaces = {
      make_contact_surface(cube_grid(12, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.z(); })};
  run.surfaces[0].plane_strain_modulus_N_per_mm2 = kModulus;
  run.surfaces[0].static_friction = run.surfaces[0].friction = friction;
  run.parts[0].radius_mm = 3;
  return run;
}

TEST(ProxyOnSoftTissue, RendersForceEnergyAndStiffnessOfTheLaw) {
  ProxyRun run = on_soft_floor();
  run.lead({0, 0, 5}, {0, 0, 1}, 0.05);
  for (int n = 0; n < 100; ++n) run.at({0, 0, 1});
  const SoftContactForce law = soft_contact_force({0, {}, kModulus}, 2, 3);
  EXPECT_TRUE(run.result.deformable);
  EXPECT_NEAR(run.result.force_N.z(), law.force_N, 0.01 * law.force_N);
  EXPECT_NEAR(run.result.stored_mJ, law.stored_mJ, 0.02 * law.stored_mJ);
  EXPECT_NEAR(run.result.tangent_N_per_mm, law.tangent_N_per_mm, 0.01 * law.tangent_N_per_mm);
  EXPECT_NEAR(run.result.stiffness_N_per_mm, law.force_N / 2, 0.01 * law.force_N / 2);
}

TEST(ProxyOnSoftTissue, SlidingOverAHardInclusionIsConservative) {
  // W decreases towards +x, as over something hard
  const ComplianceFrame frame = frame_of(1, 16, {-0.8, 0, 0});
  const auto work_mJ = [&](bool lateral) {
    ProxyRun run = on_soft_floor();
    run.compliance = &frame;
    double work = 0;
    const auto lead = [&](const Point<Patient>& from, const Point<Patient>& to) {
      const int steps = static_cast<int>((to - from).norm() / 0.01);
      Point<Patient> tip = from;
      for (int n = 1; n <= steps; ++n) {
        const Point<Patient> next = from + (to - from) * (static_cast<double>(n) / steps);
        run.at(tip);
        Vector<Patient> force_N = run.result.force_N;
        if (!lateral) force_N = {0, 0, force_N.z()};
        work -= force_N.dot(next - tip);
        tip = next;
      }
    };
    lead({-4, 0, 4}, {-4, 0, -2});
    const double insert_pending = work;
    lead({-4, 0, -2}, {5, 0, -2});
    lead({5, 0, -2}, {5, 0, 4});
    return work / insert_pending;
  };
  EXPECT_NEAR(work_mJ(true), 0, 0.01);
  EXPECT_LT(work_mJ(false), -0.2);
}

TEST(ProxyOnSoftTissue, FrictionScalesWithTheNormalForce) {
  ProxyRun run = on_soft_floor(0.2);
  run.lead({-6, 0, 5}, {-6, 0, 0}, 0.05);
  run.lead({-6, 0, 0}, {6, 0, 0}, 0.05);
  EXPECT_NEAR(-run.result.force_N.x() / run.result.force_N.z(), 0.2, 0.01);
}

TEST(ProxyOnSoftTissue, PuncturesAtItsForceForAnyDeviceStiffness) {
  ProxyRun run = on_soft_floor();
  const double rupture_N = soft_contact_force({0, {}, kModulus}, 3, 3).force_N;
  run.surfaces[0].puncture_N = rupture_N;
  run.lead({0, 0, 5}, {0, 0, 0.2}, 0.02);
  EXPECT_FALSE(run.state.punctured[0]);
  run.lead({0, 0, 0.2}, {0, 0, -0.2}, 0.02);
  for (int n = 0; n < 50; ++n) run.at({0, 0, -0.2});
  EXPECT_TRUE(run.state.punctured[0]);
}

TEST(ProxyOnSoftTissue, BoneInsideKeepsItsFullStiffness) {
  ProxyRun run = on_soft_floor();
  ContactSurface bone = make_contact_surface(cube_grid(12, {0.5, 0.5, 0.5}),
                                             [](const Eigen::Vector3d& p) { return p.z() + 4; });
  bone.stiffness_N_per_mm = 5;
  bone.layer = 1;
  bone.lower_N_per_mm = 0;
  run.surfaces.push_back(bone);
  run.lead({0, 0, 5}, {0, 0, -1.5}, 0.02);
  for (int n = 0; n < 200; ++n) run.at({0, 0, -1.5});
  const double soft_N = soft_contact_force({0, {}, kModulus}, 4.5, 3).force_N;
  EXPECT_NEAR(run.result.force_N.z(), soft_N + 5 * 0.5, 0.03);
}

}  // namespace
}  // namespace palpate
