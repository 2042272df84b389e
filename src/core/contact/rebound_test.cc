#include "palpate/contact/rebound.h"
#include "palpate/contact/contact_settings.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string>

namespace palpate {
namespace {

constexpr double kBounceTick_s = 1e-3, kBounceInner_s = 1e-5;
constexpr double kNone = std::numeric_limits<double>::infinity();

/// A mass falling on a spring, its position quantised to encoder steps. A force acts one tick after it was
/// sent, until the next one.
struct Falling {
  double mass_kg, stiffness_N_per_mm, step_mm, fall_mm_s;
  double wall_mm = 0;  ///< position of the wall within an encoder step
  double hand_N = 0;   ///< force of the operator from the first contact on
  double hand_N_s_per_mm = 0;
  bool acts = true;

  double rebound = 0;  ///< ratio of rebound to impact speed
  long limited = 0;    ///< number of ticks with a limited force

  void advance(double time_s) {
    ReboundState state;
    double x_mm = 4, mm_s = -fall_mm_s, sent_N = 0, before_N = 0, read_before_mm = 0;
    bool inside = false;
    std::array<double, 11> observed_mm{};
    for (int n = 0; n < static_cast<int>(std::lround(time_s / kBounceTick_s)); ++n) {
      const double read_mm = std::floor(x_mm / step_mm) * step_mm;
      std::copy_backward(observed_mm.begin(), observed_mm.end() - 1, observed_mm.end());
      observed_mm[0] = read_mm;
      const double requested_N = stiffness_N_per_mm * std::max(0.0, wall_mm - read_mm);
      const double acting_N = sent_N;  // force commanded in the previous tick
      if (requested_N > 0 && n > 10) {
        const double max_N =
            limit_rebound_N({before_N, read_mm - read_before_mm, (read_mm - observed_mm[10]) / 0.01, step_mm,
                             acting_N * kBounceTick_s, kBounceTick_s},
                            state);
        sent_N = acts ? std::min(requested_N, max_N) : requested_N;
        limited += max_N < requested_N;
      } else {
        state = {};
        sent_N = 0;
      }
      read_before_mm = read_mm;
      for (double t_s = 0; t_s < kBounceTick_s - 0.5 * kBounceInner_s; t_s += kBounceInner_s) {
        const double hand = x_mm < wall_mm ? -hand_N - hand_N_s_per_mm * mm_s : 0;
        mm_s += (acting_N + hand) / mass_kg * 1e3 * kBounceInner_s;
        x_mm += mm_s * kBounceInner_s;
        if (x_mm < wall_mm) inside = true;
        if (inside && x_mm > wall_mm) {
          rebound = mm_s / fall_mm_s;
          return;
        }
      }
      before_N = acting_N;
    }
  }
};

TEST(Rebound, ReboundSpeedIsAtMostTheImpactSpeedAtAnySurfaceDepth) {
  // bare devices on their recommended walls, and a heavier one; at any position of the wall within a step
  const struct {
    double mass_kg, stiffness_N_per_mm, step_mm;
  } tips[] = {{0.046, 5.01, 0.055}, {0.046, 1.5, 0.055}, {0.076, 1.16, 0.03}, {0.195, 5.01, 0.055}};
  for (const auto& [mass_kg, stiffness_N_per_mm, step_mm] : tips)
    for (const double fall_mm_s : {100.0, 200.0})
      for (int part = 0; part < 20; ++part) {
        SCOPED_TRACE(std::to_string(mass_kg) + " kg, " + std::to_string(stiffness_N_per_mm) + " N/mm, " +
                     std::to_string(fall_mm_s) + " mm/s, " + std::to_string(part));
        Falling tip{mass_kg, stiffness_N_per_mm, step_mm, fall_mm_s, -step_mm * part / 20};
        tip.advance(0.2);
        EXPECT_GT(tip.rebound, 0.6) << "a wall";
        EXPECT_LE(tip.rebound, 1.02) << "what is left the account of energy takes (StabilityGrip)";
        Falling without{mass_kg, stiffness_N_per_mm, step_mm, fall_mm_s, -step_mm * part / 20};
        without.acts = false;
        without.advance(0.2);
        EXPECT_GT(without.rebound, 1.05) << "the delay throws it";
      }
}

TEST(Rebound, PressingHandIsUnaffected) {
  for (const double fall_mm_s : {10.0, 40.0, 100.0, 200.0})
    for (const double damping_N_s_per_mm : {0.002, 0.006}) {
      SCOPED_TRACE(std::to_string(fall_mm_s) + " mm/s, " + std::to_string(damping_N_s_per_mm) + " N s/mm");
      Falling restrained{0.225, 1.16, 0.03, fall_mm_s};
      restrained.hand_N = 1;
      restrained.hand_N_s_per_mm = damping_N_s_per_mm;
      restrained.advance(0.4);
      EXPECT_EQ(restrained.limited, 0);
    }
}

TEST(Rebound, SlowContactGivesNoMassEstimate) {
  Falling slow{0.046, 5.01, 0.055, 0.7 * 750 * 0.055};
  slow.advance(0.2);
  EXPECT_EQ(slow.limited, 0);
}

TEST(Rebound, EndsAfterItsTimeLimit) {
  // a tip suspended in a wall, as if about to reverse for ever
  ReboundState state;
  const double impact_mm_s = 100, step_mm = 0.03;
  int last = 0;
  for (int n = 0; n < 100; ++n) {
    const ReboundInput input{2, n < 5 ? -0.05 : 0, -impact_mm_s, step_mm, 2e-3, kBounceTick_s};
    const double max_N = limit_rebound_N(input, state);
    EXPECT_GE(max_N, 0);
    if (max_N < kNone) last = n;
  }
  EXPECT_GT(last, 5);
  EXPECT_LE(last * kBounceTick_s, kReboundSettings.max_contact_s + kBounceTick_s);
}

TEST(Rebound, UnforcedMotionGivesNoMassEstimate) {
  ReboundState state;
  for (int n = 0; n < 30; ++n)
    EXPECT_EQ(limit_rebound_N({3, -0.1, -100, 0.03, 3e-3, kBounceTick_s}, state), kNone) << n;
  ReboundState pushed;
  for (int n = 0; n < 30; ++n)
    EXPECT_EQ(limit_rebound_N({3, -0.2, -100, 0.03, 3e-3, kBounceTick_s}, pushed), kNone) << "by a hand";
}

}  // namespace
}  // namespace palpate
