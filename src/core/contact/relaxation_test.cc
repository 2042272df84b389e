#include "palpate/contact/relaxation.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "base/test_seed.h"
#include "contact/test_proxy_surfaces.h"
#include "palpate/contact/soft_contact.h"

namespace palpate {
namespace {

using test::test_seed;
using testing::cube_grid;
using testing::make_contact_surface;
using testing::ProxyRun;

constexpr Relaxation kTwoTerms{{{{0.3, 0.5}, {0.2, 8}}}};
constexpr double kModulus_N_per_mm2 = 0.0125;  // E = 10 kPa, nu = 0.45

RelaxationTimes times_of(const Relaxation& relaxation) {
  RelaxationTimes times;
  EXPECT_TRUE(times.add(relaxation));
  return times;
}

/// A tool at one point of tissue with one series, driven by its instantaneous elastic force.
struct Relaxing {
  explicit Relaxing(const Relaxation& relaxation) : times(times_of(relaxation)) {
    contact.fractions.add(relaxation, times, 1);
    contact.dent_radius_mm = 6;
    contact.blend_s = 1.0 / 64;
  }
  double at(double elastic_N, double dt_s) {
    return advance_relaxation(times, elastic_N, elastic_N > 0 ? &contact : nullptr, dt_s, state);
  }

  RelaxationTimes times;
  RelaxingContact contact;
  RelaxationState state;
};

// relaxation function E(t) / E
double left_of(const Relaxation& relaxation, double time_s) {
  double left = 1;
  for (const RelaxationTerm& one : relaxation.term)
    if (one.fraction > 0) left -= one.fraction * (1 - std::exp(-time_s / one.time_s));
  return left;
}
// force for an elastic force that increases by 1 N/s from time 0
double ramped_N(const Relaxation& relaxation, double time_s) {
  double force_N = (1 - relaxation.total_fraction()) * time_s;
  for (const RelaxationTerm& one : relaxation.term)
    if (one.fraction > 0) force_N += one.fraction * one.time_s * (1 - std::exp(-time_s / one.time_s));
  return force_N;
}

TEST(Decay, IsAnExponentialOverTheWholeRange) {
  for (double x = 1e-9; x < 600; x *= 1.07) {
    EXPECT_NEAR(decay(x).remaining / std::exp(-x), 1, 1e-13 * std::max(1.0, x)) << x;
    EXPECT_NEAR(decay(x).mean / (-std::expm1(-x) / x), 1, x < 0.02 ? 2e-15 : 2e-14) << x;
    EXPECT_GE(decay(x).mean, decay(x).remaining) << x;
  }
  EXPECT_EQ(decay(0).remaining, 1);
  EXPECT_EQ(decay(0).mean, 1);
  EXPECT_GE(decay(1e9).remaining, 0);
  EXPECT_NEAR(decay(1e9).remaining, 0, 1e-300);
}

TEST(RelaxationTimes, AreSortedAndUnique) {
  RelaxationTimes times;
  EXPECT_FALSE(times.any());
  EXPECT_TRUE(times.add({}));
  EXPECT_FALSE(times.any());
  EXPECT_TRUE(times.add({{{{0.1, 8}, {0.2, 0.5}}}}));
  EXPECT_TRUE(times.add({{{{0.3, 0.5}, {}}}}));
  EXPECT_TRUE(times.add({{{{0.3, 2}, {}}}}));
  ASSERT_EQ(times.count, 3u);
  EXPECT_EQ(times.time_s[0], 0.5);
  EXPECT_EQ(times.time_s[1], 2);
  EXPECT_EQ(times.time_s[2], 8);
  RelaxationFractions parts;
  parts.add({{{{0.1, 8}, {0.2, 0.5}}}}, times, 0.5);
  EXPECT_EQ(parts.of_time[0], 0.1);
  EXPECT_EQ(parts.of_time[1], 0);
  EXPECT_EQ(parts.of_time[2], 0.05);
  for (int n = 3; n < static_cast<int>(kMaxRelaxationTimes); ++n)
    EXPECT_TRUE(times.add({{{{0.3, 10.0 + n}, {}}}}));
  EXPECT_TRUE(times.add({{{{0.3, 2}, {}}}})) << "which it has";
  EXPECT_FALSE(times.add({{{{0.3, 500}, {}}}}));
}

TEST(AdvanceRelaxation, HeldStepMatchesTheStandardLinearSolid) {
  for (const Relaxation& relaxation : {Relaxation{{{{0.6, 0.3}, {}}}}, kTwoTerms}) {
    Relaxing tissue(relaxation);
    double worst = 0, time_s = -0.0005;
    for (int n = 0; n < 20'000; ++n) {
      const double force_N = tissue.at(2, 0.001);
      time_s += 0.001;
      if (n > 0) worst = std::max(worst, std::abs(force_N / (2 * left_of(relaxation, time_s)) - 1));
    }
    EXPECT_LT(worst, 1e-5);
    EXPECT_NEAR(tissue.at(2, 1e6), 2 * (1 - relaxation.total_fraction()), 1e-6) << "in the end";
  }
}

TEST(AdvanceRelaxation, HeldRampIsExactForAnyTickLength) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> dt(1e-4, 0.02);
  constexpr double kRamp_s = 0.7, kRate_N_per_s = 3;
  Relaxing tissue(kTwoTerms);
  double time_s = 0;
  while (time_s < 4) {
    // a tick boundary coincides with the end of the ramp
    const double ends_s = time_s < kRamp_s ? kRamp_s - time_s : 1;
    const double dt_s = std::min(dt(random), ends_s);
    time_s += dt_s;
    const double force_N = tissue.at(kRate_N_per_s * std::min(time_s, kRamp_s), dt_s);
    const double target_N = kRate_N_per_s * (ramped_N(kTwoTerms, time_s) -
                                             (time_s > kRamp_s ? ramped_N(kTwoTerms, time_s - kRamp_s) : 0));
    ASSERT_NEAR(force_N / target_N, 1, 1e-11) << time_s;
  }
}

TEST(AdvanceRelaxation, SineDissipationMatchesThePronySeries) {
  for (const double hz : {0.1, 0.3, 1.0, 3.0, 10.0}) {
    const double omega = 2 * std::numbers::pi * hz;
    double stored = 1, lost = 0;
    for (const RelaxationTerm& one : kTwoTerms.term) {
      const double x = omega * one.time_s;
      stored -= one.fraction / (1 + x * x);
      lost += one.fraction * x / (1 + x * x);
    }
    // continuous contact; over whole periods after the transient has decayed
    Relaxing tissue(kTwoTerms);
    constexpr double kTick_s = 0.001;
    const int period = static_cast<int>(std::lround(1 / (hz * kTick_s)));
    const int settle = period * static_cast<int>(std::ceil(120 * hz)), seen = period * 4;
    double sine = 0, cosine = 0;
    for (int n = 1; n <= settle + seen; ++n) {
      const double phase = 2 * std::numbers::pi * (n % period) / period;
      const double force_N = tissue.at(4 + std::sin(phase), kTick_s);
      if (n <= settle) continue;
      sine += 2 * force_N * std::sin(phase) / seen;
      cosine += 2 * force_N * std::cos(phase) / seen;
    }
    EXPECT_NEAR(sine / stored, 1, 1e-3) << hz;
    EXPECT_NEAR(std::atan2(cosine, sine) / std::atan2(lost, stored), 1, 0.01) << hz;
  }
}

TEST(AdvanceRelaxation, PressesSuperpose) {
  Relaxing both(kTwoTerms), first(kTwoTerms), second(kTwoTerms);
  for (int n = 1; n <= 3000; ++n) {
    const double time_s = 0.001 * n;
    const double one_N = 2 * std::min(1.0, time_s / 0.2), other_N = std::clamp(time_s - 1, 0.0, 0.3);
    const double sum_N = first.at(one_N, 0.001) + second.at(other_N, 0.001);
    ASSERT_NEAR(both.at(one_N + other_N, 0.001), sum_N, 1e-12) << n;
  }
}

TEST(AdvanceRelaxation, WithoutTermsEqualsTheElasticForceBitwise) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> force(-1, 3);
  Relaxing tissue(kTwoTerms);
  tissue.contact.fractions = {};
  for (int n = 0; n < 1000; ++n) {
    const double elastic_N = std::max(0.0, force(random));
    ASSERT_EQ(tissue.at(elastic_N, 0.001), elastic_N);
  }
}

TEST(AdvanceRelaxation, ReleasedDentRecoversLikeFreeTissue) {
  constexpr double kPart = 0.6, kTime_s = 0.5;
  Relaxing tissue({{{{kPart, kTime_s}, {}}}});
  for (int n = 0; n < 10'000; ++n) tissue.at(2, 0.001);
  EXPECT_EQ(tissue.at(0, 0.001), 0) << "out at once: no force, and none that pulls";
  const double dent_N = tissue.state.elastic_N;
  EXPECT_NEAR(dent_N, 2 * kPart, 0.01) << "as deep as the force that was lost pressed";
  // with the creep time constant
  for (int n = 0; n < 800; ++n) tissue.at(0, 0.001);
  EXPECT_NEAR(tissue.state.elastic_N / (dent_N * std::exp(-0.8 * (1 - kPart) / kTime_s)), 1, 1e-6);

  // a second contact starts deeper
  const double left_N = tissue.state.elastic_N;
  Relaxing again = tissue;
  EXPECT_EQ(again.at(0.99 * left_N, 1e-6), 0);
  EXPECT_NEAR(again.at(left_N + 0.5, 1e-6), 0.5, 1e-5);
  // half of the dent at half of its radius, none beyond
  Relaxing beside = tissue, beyond = tissue;
  beside.contact.at = Point<Patient>(3, 0, 0);
  EXPECT_EQ(beside.at(0.49 * left_N, 1e-6), 0);
  EXPECT_NEAR(beside.at(0.5 * left_N + 0.3, 1e-6), 0.3, 1e-5);
  beyond.contact.at = Point<Patient>(0, 6.1, 0);
  EXPECT_NEAR(beyond.at(0.1, 1e-6), 0.1, 1e-6);
  // in the end the state is empty
  for (int n = 0; n < 100; ++n) tissue.at(0, 1);
  EXPECT_FALSE(tissue.state.is_active());
  EXPECT_EQ(tissue.state.lagging_N[0], 0);
}

TEST(AdvanceRelaxation, ChangedTermsBlendInWithoutAForceStep) {
  Relaxing tissue(kTwoTerms);
  for (int n = 0; n < 5000; ++n) tissue.at(2, 0.001);
  double before_N = tissue.at(2, 0.001);
  tissue.contact.fractions = {};
  for (int n = 0; n < 400; ++n) {
    const double now_N = tissue.at(2, 0.001);
    ASSERT_GE(now_N, before_N);
    ASSERT_LT(now_N - before_N, 0.07);
    before_N = now_N;
  }
  EXPECT_NEAR(before_N, 2, 1e-6);
}

/// A sphere moved in and out at one point of tissue.
struct PressedSphere {
  ContactLaw tissue{0, {}, kModulus_N_per_mm2};
  double radius_mm = 3, max_N_per_mm = std::numeric_limits<double>::infinity();
  Relaxing relaxing;
  double depth_mm = -1, force_N = 0, elastic_N = 0;

  // stored energy by the law's complementary energy (docs/decisions/archive/0040-relaxation.md)
  double stored_mJ() const {
    double stored = force_N * std::max(0.0, depth_mm) -
                    complementary_mJ(tissue, relaxing.state.elastic_N, radius_mm, max_N_per_mm);
    for (std::size_t n = 0; n < relaxing.times.count; ++n)
      stored += relaxing.state.fractions.of_time[n] *
                complementary_mJ(tissue, relaxing.state.lagging_N[n], radius_mm, max_N_per_mm);
    return stored;
  }
  // moves to a depth; returns the work done
  double to(double next_mm, double dt_s) {
    const double before_N = force_N, before_mm = depth_mm;
    depth_mm = next_mm;
    elastic_N = soft_contact_force(tissue, depth_mm, radius_mm, max_N_per_mm).force_N;
    force_N = relaxing.at(elastic_N, dt_s);
    return 0.5 * (before_N + force_N) * (depth_mm - before_mm);
  }
};

TEST(ComplementaryEnergy, IsForceTimesDepthMinusStoredEnergy) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  for (int n = 0; n < 5000; ++n) {
    ContactLaw tissue{0, {}, std::pow(10, 3 * unit(random) - 3)};
    tissue.surroundings_mm_per_N = (2 * unit(random) - 0.8) / (2 * tissue.modulus_N_per_mm2);
    if (n % 2 == 0) {
      // a neo-Hookean solution, stiffer or softer by up to a fifth of W
      tissue.reference_force_N = std::pow(10, 2 * unit(random) - 2);
      tissue.stiffening_mm_per_N2 =
          (0.4 * unit(random) - 0.2) / (tissue.modulus_N_per_mm2 * tissue.reference_force_N);
    }
    const double radius_mm = 0.5 + 7 * unit(random), depth = std::pow(10, 3 * unit(random) - 2);
    const double largest = unit(random) < 0.5 ? std::pow(10, 3 * unit(random) - 2) : 1e9;
    const SoftContactForce force = soft_contact_force(tissue, depth, radius_mm, largest);
    ASSERT_NEAR(complementary_mJ(tissue, force.force_N, radius_mm, largest) /
                    (force.force_N * depth - force.stored_mJ),
                1, 1e-9)
        << n;
  }
}

// Random holding, fast motion, withdrawal and renewed contact: the work put in covers the stored energy after
// every tick, and no tick returns more than the stored energy decreases.
TEST(AdvanceRelaxation, IsPassiveOnRandomPaths) {
  const unsigned seed = test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> unit(0, 1);
  double min_left = 1;
  for (int path = 0; path < 200; ++path) {
    const double part = 0.9 * unit(random), first = unit(random);
    const Relaxation relaxation{{{{0.01 + part * first, std::pow(10, 2 * unit(random) - 1.5)},
                                  {0.01 + part * (1 - first), std::pow(10, 2 * unit(random) - 1)}}}};
    PressedSphere sphere{.relaxing = Relaxing(relaxation)};
    sphere.tissue.surroundings_mm_per_N = (2 * unit(random) - 0.5) / (6 * kModulus_N_per_mm2);
    if (path % 2 == 0) sphere.max_N_per_mm = 0.1 + unit(random);
    if (path % 4 < 2) {
      sphere.tissue.reference_force_N = 0.05 + 0.3 * unit(random);
      sphere.tissue.stiffening_mm_per_N2 =
          (0.06 * unit(random) - 0.03) / (kModulus_N_per_mm2 * sphere.tissue.reference_force_N);
    }
    double work_mJ = 0, lost_mJ = 0, max_mJ = 0, goal_mm = 0, speed_mm_s = 0;
    for (int n = 0; n < 3000; ++n) {
      constexpr double kShort_s = 2e-4;
      if (unit(random) < 0.01) {
        goal_mm = 6 * unit(random) - 1.5;
        speed_mm_s = unit(random) < 0.3 ? 0 : std::pow(10, 2.5 * unit(random) - 0.5);
      }
      const double distance_mm =
          std::clamp(goal_mm - sphere.depth_mm, -speed_mm_s * kShort_s, speed_mm_s * kShort_s);
      const double before_mJ = sphere.stored_mJ();
      const double in_mJ = sphere.to(sphere.depth_mm + distance_mm, kShort_s);
      work_mJ += in_mJ;
      max_mJ = std::max(max_mJ, work_mJ);
      lost_mJ = std::min(lost_mJ, in_mJ - (sphere.stored_mJ() - before_mJ));
      ASSERT_GE(sphere.force_N, 0);
      ASSERT_LE(sphere.force_N, sphere.elastic_N);
      ASSERT_GE(sphere.stored_mJ(), -1e-9) << path;
      // the work of a tick is that of a linear force between its ends
      ASSERT_GE(work_mJ - sphere.stored_mJ(), -1e-5 * std::max(1.0, max_mJ)) << path << ", tick " << n;
    }
    ASSERT_GE(lost_mJ, -1e-5 * std::max(1.0, max_mJ)) << path;
    if (max_mJ > 0) min_left = std::min(min_left, (work_mJ - sphere.stored_mJ()) / max_mJ);
  }
  EXPECT_GE(min_left, 0);
}

TEST(AdvanceRelaxation, IsAtMostAsStiffAsTheInstantaneousLaw) {
  // bounded by the stiffness limit times the displacement, plus the relaxation and recovery of a tick
  constexpr double kMax_N_per_mm = 0.05, kDown_mm = 0.005, kShort_s = 1e-4;
  PressedSphere sphere{.max_N_per_mm = kMax_N_per_mm, .relaxing = Relaxing(kTwoTerms)};
  double before_N = 0, steepest_N = 0;
  for (int n = 0; n < 2000; ++n) {
    sphere.to(std::max(sphere.depth_mm, 0.0) + (n < 1000 ? kDown_mm : -kDown_mm), kShort_s);
    double relaxed_N = 0;
    for (const RelaxationTerm& one : kTwoTerms.term)
      relaxed_N += one.fraction * sphere.relaxing.state.elastic_N * kShort_s / one.time_s;
    const double change_N = sphere.force_N - before_N;
    ASSERT_LE(change_N, n < 1000 ? kMax_N_per_mm * kDown_mm * (1 + 1e-9) : relaxed_N) << n;
    ASSERT_GE(change_N, -kMax_N_per_mm * kDown_mm * (1 + 1e-9) - relaxed_N) << n;
    steepest_N = std::max(steepest_N, change_N);
    before_N = sphere.force_N;
  }
  EXPECT_GT(steepest_N, 0.95 * kMax_N_per_mm * kDown_mm);
}

// deformable and relaxing half-space below z = 0
struct RelaxingFloor {
  explicit RelaxingFloor(const Relaxation& relaxation) : times(times_of(relaxation)) {
    run.surfaces = {
        make_contact_surface(cube_grid(12, {0.5, 0.5, 0.5}), [](const Eigen::Vector3d& p) { return p.z(); })};
    run.surfaces[0].plane_strain_modulus_N_per_mm2 = kModulus_N_per_mm2;
    run.surfaces[0].relaxed.add(relaxation, times, 1);
    run.parts[0].radius_mm = 3;
    run.relaxation_times = &times;
  }
  void wait(const Point<Patient>& at, double time_s) {
    for (int n = 0; n < time_s * 1000; ++n) run.at(at);
  }
  RelaxationTimes times;
  ProxyRun run;
};

TEST(ProxyOnRelaxingTissue, ForceDecaysFromTickToTick) {
  RelaxingFloor floor(kTwoTerms);
  floor.run.lead({0, 0, 5}, {0, 0, 3.05}, 0.05);
  floor.run.lead({0, 0, 3.05}, {0, 0, 1}, 0.41);
  const double law_N = soft_contact_force({0, {}, kModulus_N_per_mm2}, 2, 3).force_N;
  double waited_s = 0;
  for (const double time_s : {0.1, 0.4, 0.5, 2.0}) {
    floor.wait({0, 0, 1}, time_s);
    waited_s += time_s;
    // at the middle of the five ticks of the approach
    const double target_N = law_N * left_of(kTwoTerms, waited_s + 0.002);
    EXPECT_NEAR(floor.run.result.force_N.z() / target_N, 1, 0.01) << waited_s;
  }
  // the recoverable energy is less than the work of pressing
  const SoftContactForce law = soft_contact_force({0, {}, kModulus_N_per_mm2}, 2, 3);
  EXPECT_GT(floor.run.result.stored_mJ, 0);
  EXPECT_LT(floor.run.result.stored_mJ, 0.8 * law.stored_mJ);
  EXPECT_NEAR(floor.run.result.tangent_N_per_mm, law.tangent_N_per_mm, 0.02 * law.tangent_N_per_mm);
  EXPECT_NEAR(floor.run.result.stiffness_N_per_mm, floor.run.result.force_N.z() / 2, 1e-3);
}

TEST(ProxyOnRelaxingTissue, LeavesADentOnlyAtTheContact) {
  RelaxingFloor floor({{{{0.6, 0.5}, {}}}});
  floor.run.lead({0, 0, 5}, {0, 0, 0}, 0.05);
  floor.wait({0, 0, 0}, 3);
  const double sustained_N = floor.run.result.force_N.z();
  floor.run.lead({0, 0, 0}, {0, 0, 4}, 0.2);
  EXPECT_EQ(floor.run.result.force_N, Vector<Patient>());
  const ProxyRun left = floor.run;
  // renewed contact at the same point starts deeper; 10 mm beside it there is no memory
  const auto force_N = [&](double x) {
    ProxyRun run = left;
    run.lead({0, 0, 4}, {x, 0, 4}, 0.5);
    run.lead({x, 0, 4}, {x, 0, 2}, 0.1);
    return run.result.force_N.z();
  };
  const double first_N = soft_contact_force({0, {}, kModulus_N_per_mm2}, 1, 3).force_N;
  EXPECT_EQ(force_N(0), 0);
  EXPECT_NEAR(force_N(10), first_N, 0.05 * first_N);
  EXPECT_GT(sustained_N, 0);
}

TEST(ProxyOnRelaxingTissue, EmptySeriesEqualsNoSeriesBitwise) {
  RelaxingFloor floor(kTwoTerms);
  floor.run.surfaces[0].relaxed = {};
  ProxyRun without = floor.run;
  without.relaxation_times = nullptr;
  ComplianceFrame frame;
  frame.number = 1;
  frame.local_compliance[0] = {Point<Patient>(0, 0, 0), 16, Vector<Patient>(-0.3, 0.1, 0), kModulus_N_per_mm2,
                               3};
  floor.run.compliance = without.compliance = &frame;
  for (int n = 0; n < 400; ++n) {
    const Point<Patient> tip(0.01 * n, 0.002 * n, 4 - 4 * std::sin(0.03 * n));
    floor.run.at(tip);
    without.at(tip);
    ASSERT_EQ(floor.run.result.force_N, without.result.force_N) << n;
    ASSERT_EQ(floor.run.result.stiffness_N_per_mm, without.result.stiffness_N_per_mm) << n;
    ASSERT_NEAR(floor.run.result.stored_mJ, without.result.stored_mJ, 1e-12) << n;
  }
}

TEST(ProxyOnRelaxingTissue, FrameReportsTheRelaxingFraction) {
  RelaxingFloor floor(kTwoTerms);
  ComplianceFrame frame;
  frame.number = 1;
  frame.local_compliance[0] = {Point<Patient>(0, 0, 0), 16, {}, kModulus_N_per_mm2, 3};
  // half of the displacement is in non-relaxing tissue
  frame.local_compliance[0].relaxed.add(kTwoTerms, floor.times, 0.5);
  floor.run.compliance = &frame;
  floor.run.lead({0, 0, 5}, {0, 0, 1}, 0.4);
  const double at_once_N =
      soft_contact_force({16 - 0.6 / (3 * kModulus_N_per_mm2), {}, kModulus_N_per_mm2}, 2, 3).force_N;
  floor.wait({0, 0, 1}, 100);
  EXPECT_NEAR(floor.run.result.force_N.z() / at_once_N, 1 - 0.5 * kTwoTerms.total_fraction(), 0.01);
}

TEST(ComplianceFrame, HashCoversRelaxationOnlyWherePresent) {
  ComplianceFrame frame;
  const std::uint64_t none = frame.hash();
  frame.local_compliance[1].relaxed.of_time[3] = 0.25;
  const std::uint64_t one = frame.hash();
  EXPECT_NE(one, none);
  std::swap(frame.local_compliance[1].relaxed.of_time[3], frame.local_compliance[1].relaxed.of_time[4]);
  EXPECT_NE(frame.hash(), one);
}

}  // namespace
}  // namespace palpate
