#include "palpate/contact/oscillation.h"
#include "palpate/contact/contact_settings.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <numbers>

namespace palpate {
namespace {

constexpr double kSwingStep_mm = 0.03;

struct MeasuredSwing {
  double found_s = -1;       ///< time of detection since the beginning
  double extra_delay_s = 0;  ///< estimate at the end
};

// a tip on a prescribed path, quantised to encoder steps, and a force along x that depends on its position
MeasuredSwing measure_swing(const std::function<Vector<World>(double)>& tip_at,
                            const std::function<double(const Vector<World>&)>& force_N_at, double time_s,
                            double rate_hz = 1000) {
  OscillationState state;
  MeasuredSwing observed;
  const auto read = [&](double at_s) {
    const Vector<World> tip = tip_at(at_s);
    return Vector<World>((tip / kSwingStep_mm).eigen().array().floor().matrix() * kSwingStep_mm);
  };
  for (int n = 1; n < time_s * rate_hz; ++n) {
    const Vector<World> tip = read(n / rate_hz);
    const Vector<World> force_N(std::max(0.0, force_N_at(tip)), 0, 0);
    detect_oscillation(force_N, tip - read((n - 1) / rate_hz), kSwingStep_mm, 1 / rate_hz, state);
    if (state.extra_delay_s > 0 && observed.found_s < 0) observed.found_s = n / rate_hz;
  }
  observed.extra_delay_s = state.extra_delay_s;
  return observed;
}

double wall_N(const Vector<World>& tip) {
  return -1.2 * tip.x();
}

// an oscillation about 1 mm below a wall
MeasuredSwing watch_swing(double frequency_hz, double peak_to_peak_mm, double rate_hz = 1000) {
  return measure_swing(
      [=](double t) {
        return Vector<World>(-1 + 0.5 * peak_to_peak_mm * std::sin(2 * std::numbers::pi * frequency_hz * t),
                             0, 0);
      },
      wall_N, 2, rate_hz);
}

TEST(Oscillation, LimitCycleIsDetectedWithin100msOrThreeHalfPeriods) {
  const struct {
    double frequency_hz, peak_to_peak_mm;
  } cycles[] = {{37, 0.9}, {20, 0.88}, {16, 1.2}, {12, 1.9}, {9, 6}, {60, 0.3}};
  for (const auto& [frequency_hz, peak_to_peak_mm] : cycles)
    for (const double rate_hz : {500.0, 1000.0, 4000.0}) {
      SCOPED_TRACE(std::to_string(frequency_hz) + " Hz, at " + std::to_string(rate_hz));
      const MeasuredSwing observed = watch_swing(frequency_hz, peak_to_peak_mm, rate_hz);
      EXPECT_GT(observed.found_s, 0);
      // the first quarter is not a half cycle, and a reversal is detected only after some displacement back
      EXPECT_LT(observed.found_s, std::max(0.1, 1.9 / frequency_hz) + 0.01);
      EXPECT_GT(observed.extra_delay_s,
                kOscillationSettings.max_extra_delay_s - kOscillationSettings.delay_increment_s)
          << "as long as it goes on";
    }
}

TEST(Oscillation, IsDetectedAtTheEndOfItsLastHalfPeriod) {
  constexpr double kLeg_mm = 2, kLeg_s = 0.04;
  const auto to_and_fro = [](double t) {
    const double phase = std::fmod(t / kLeg_s, 2);
    return Vector<World>(-2 + kLeg_mm * (phase < 1 ? phase : 2 - phase), 0, 0);
  };
  const double found_s = measure_swing(to_and_fro, wall_N, 1).found_s;
  EXPECT_GT(found_s, kOscillationSettings.min_half_cycles * kLeg_s);
  EXPECT_LT(found_s, (kOscillationSettings.min_half_cycles + 0.25) * kLeg_s);
}

TEST(Oscillation, HandMotionIsNoLimitCycle) {
  for (const double frequency_hz : {8.0, 10.0, 12.0}) {
    SCOPED_TRACE("a tremor of " + std::to_string(frequency_hz) + " Hz");
    EXPECT_EQ(watch_swing(frequency_hz, 0.4).extra_delay_s, 0);
  }
  for (const double frequency_hz : {1.0, 3.0, 5.0, 6.0}) {
    SCOPED_TRACE("tapping " + std::to_string(frequency_hz) + " times a second");
    EXPECT_EQ(watch_swing(frequency_hz, 12).extra_delay_s, 0);
    EXPECT_EQ(watch_swing(frequency_hz, 1.5).extra_delay_s, 0);
  }
  for (const double speed_mm_s : {10.0, 30.0, 60.0, 120.0}) {
    SCOPED_TRACE("sliding over ribs of 1 mm, 4 mm apart, with " + std::to_string(speed_mm_s) + " mm/s");
    const auto rib_mm = [](double y) { return 0.5 * std::sin(2 * std::numbers::pi * y / 4); };
    EXPECT_EQ(
        measure_swing([&](double t) { return Vector<World>(rib_mm(speed_mm_s * t) - 1, speed_mm_s * t, 0); },
                      [&](const Vector<World>& tip) { return 1.2 * (rib_mm(tip.y()) - tip.x()); }, 2)
            .extra_delay_s,
        0);
  }
  {
    SCOPED_TRACE("a touch that dies down");
    const auto dies = [](double t) {
      return Vector<World>(-1 + 2 * std::exp(-t / 0.05) * std::cos(2 * std::numbers::pi * 14 * t), 0, 0);
    };
    EXPECT_EQ(measure_swing(dies, wall_N, 2).extra_delay_s, 0);
  }
  {
    SCOPED_TRACE("in the air");
    EXPECT_EQ(measure_swing([](double t) { return Vector<World>(5 + std::sin(100 * t), 0, 0); }, wall_N, 2)
                  .extra_delay_s,
              0);
  }
}

TEST(Oscillation, DetectionDecaysSlowly) {
  OscillationState state;
  state.extra_delay_s = 3e-3;
  for (int n = 0; n < 10'000; ++n) detect_oscillation({}, {}, kSwingStep_mm, 1e-3, state);
  EXPECT_NEAR(state.extra_delay_s, 2e-3, 1e-9) << "a millisecond in 10 s, in the air, too";
}

}  // namespace
}  // namespace palpate
