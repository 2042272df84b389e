#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <complex>
#include <cstdlib>
#include <numbers>
#include <random>
#include <string>
#include <vector>

#include "base/test_chart.h"
#include "base/test_seed.h"
#include "palpate/servo/burr_rendering.h"
#include "palpate/tissue/tissue_settings.h"
#include "servo/test_guided_burr.h"

namespace palpate {
namespace {

using testing::burr_model;
using testing::GuidedSession;
using testing::kBoneRadius_mm;
using testing::kBurrRadius_mm;
using testing::kBurrTick_s;

constexpr double kMinute_s = 60;

BurrSettings burr_of(double revolutions_per_min, int flutes) {
  BurrSettings burr{.spindle = Eigen::Vector3d(1, 0, 0)};
  burr.revolutions_per_s = revolutions_per_min / kMinute_s;
  burr.flutes = flutes;
  return burr;
}

/// Amplitude of a signal's component at a frequency: discrete Fourier transform at that frequency.
double component(const std::vector<double>& signal, double hz, double dt_s) {
  std::complex<double> sum;
  for (std::size_t n = 0; n < signal.size(); ++n)
    sum += signal[n] * std::polar(1.0, -2 * std::numbers::pi * hz * dt_s * static_cast<double>(n));
  return 2 * std::abs(sum) / static_cast<double>(signal.size());
}

/// A burr that is guided into the bone, once with and once without vibration: the path is the same, and so
/// the forces differ by what is rendered.
struct Drilling {
  double speed_mm_s = 2, rate_hz = 1000, energy_mJ_per_mm3 = 100, max_force_N = 10, time_s = 1.5;
  BurrSettings burr = burr_of(60000, 8);
  bool vibrates = true;

  std::vector<double> along_N{},
      normal_N{};  // per tick; along: in the direction in which the head would roll
  std::vector<DeviceTick> ticks{};
  std::uint64_t hash = 0;

  Drilling& run() {
    GuidedSession guided;
    Model model = *guided.model;
    model.tools[0].burr = burr;
    for (ContactSurface& surface : model.surfaces) surface.cutting_energy_mJ_per_mm3 = energy_mJ_per_mm3;
    guided.model = std::make_shared<const Model>(model);
    guided.carving = std::make_shared<const Carving>(model);
    guided.state = {};
    guided.state.device[0].output.gain = 1;
    guided.parameters.vibration = vibrates;
    guided.parameters.max_force_N = max_force_N;
    const double dt_s = 1 / rate_hz;
    // the spindle points along x, the surface up: clockwise seen from the handle, the head rolls along y
    const Vector<World> along = model.X_WorldPatient * Vector<Patient>(0, 1, 0),
                        up = model.X_WorldPatient * Vector<Patient>(0, 0, 1);
    const long ticks_a_carve = std::lround(0.02 * rate_hz), count = std::lround(time_s * rate_hz);
    for (long n = 0; n < count; ++n) {
      guided.device.tip = guided.above(0.1 - speed_mm_s * dt_s * static_cast<double>(n));
      if (n % ticks_a_carve == 0) guided.carve();
      tick(*guided.model, guided.parameters, {&guided.device, 1}, dt_s, guided.state, {&guided.wrench, 1},
           guided.record);
      along_N.push_back(guided.wrench.force_N.dot(along));
      normal_N.push_back(guided.wrench.force_N.dot(up));
      ticks.push_back(guided.record.device[0]);
    }
    hash = guided.record.state_hash;
    return *this;
  }
  /// Rendered in addition to the contact, in the last `last_s`.
  std::vector<double> rendered_N(double last_s) {
    Drilling still = *this;
    still.along_N.clear();
    still.vibrates = false;
    still.run();
    std::vector<double> signal;
    for (std::size_t n = along_N.size() - static_cast<std::size_t>(std::lround(last_s * rate_hz));
         n < along_N.size(); ++n)
      signal.push_back(along_N[n] - still.along_N[n]);
    return signal;
  }
};

TEST(BurrVibration, FrequencyFollowsTheEdgesWithinTheBandOrTheRotation) {
  EXPECT_NEAR(vibration_hz(burr_of(2500, 2), 1e-3), 2 * 2500 / 60.0, 1e-12);
  EXPECT_NEAR(vibration_hz(burr_of(1500, 8), 1e-3), 200, 1e-12) << "at the band's end";
  EXPECT_NEAR(vibration_hz(burr_of(9000, 8), 1e-3), 150, 1e-12) << "a revolution";
  EXPECT_NEAR(vibration_hz(burr_of(60000, 8), 1e-3), 200, 1e-12) << "every fifth revolution";
  EXPECT_NEAR(vibration_hz(burr_of(60000, 8), 1e-4), 200, 1e-12) << "shorter ticks do not widen the band";
  EXPECT_NEAR(vibration_hz(burr_of(60000, 8), 4e-3), 62.5, 1e-12) << "four ticks a period";
  std::mt19937_64 random(test::test_seed());
  for (int n = 0; n < 1000; ++n) {
    const double rate_hz = std::uniform_real_distribution(250.0, 10000.0)(random);
    const BurrSettings burr = burr_of(std::uniform_real_distribution(100.0, 200000.0)(random),
                                      std::uniform_int_distribution(1, 40)(random));
    const double hz = vibration_hz(burr, 1 / rate_hz);
    ASSERT_LE(hz, std::min(200.0, rate_hz / 4) * (1 + 1e-12));
    const double edges_hz = burr.revolutions_per_s * burr.flutes;
    const double revolutions = burr.revolutions_per_s / hz;
    ASSERT_TRUE(hz == edges_hz || std::abs(revolutions - std::round(revolutions)) < 1e-9) << hz;
    if (hz != edges_hz && std::round(revolutions) > 1) {
      ASSERT_GT(burr.revolutions_per_s / (std::round(revolutions) - 1), std::min(200.0, rate_hz / 4))
          << "not the highest one";
    }
  }
}

TEST(BurrVibration, AmplitudeFollowsTheCuttingForceAndTheDepthOfCut) {
  std::mt19937_64 random(test::test_seed());
  const auto between = [&](double low, double high) {
    return std::uniform_real_distribution(low, high)(random);
  };
  for (int n = 0; n < 1000; ++n) {
    const BurrSettings burr = burr_of(between(1000, 80000), 8);
    BurrState state;
    state.pressed_N = between(0, 5);
    state.edge_speed_mm_s = between(10, 10000);
    state.front_mm2 = between(0.1, 20);
    state.energy_mJ_per_mm3 = between(1, 200);
    const double hz = vibration_hz(burr, 1e-3);
    const double amplitude_N = vibration_amplitude_N(burr, state, hz);
    // independently: the volume that a revolution removes, or an edge, over the area ahead
    const double power_mW = burr.grip * state.pressed_N * state.edge_speed_mm_s;
    const double cuts_per_s = hz == burr.revolutions_per_s * burr.flutes ? hz : burr.revolutions_per_s;
    const double depth_mm = power_mW / state.energy_mJ_per_mm3 / cuts_per_s / state.front_mm2;
    const double law_N = burr.grip * state.pressed_N / (1 + depth_mm / kBurrRenderingSettings.runout_mm);
    ASSERT_NEAR(amplitude_N, law_N, 1e-12);
    BurrState harder = state, heavier = state, idle = state;
    harder.energy_mJ_per_mm3 *= 1.1;
    heavier.pressed_N = 1.1 * state.pressed_N + 0.01;
    idle.front_mm2 = 0;
    ASSERT_GE(vibration_amplitude_N(burr, harder, hz), amplitude_N);
    ASSERT_GT(vibration_amplitude_N(burr, heavier, hz), amplitude_N);
    ASSERT_EQ(vibration_amplitude_N(burr, idle, hz), 0);
  }
}

TEST(BurrVibration, SpectrumHasItsPeakAtTheStatedFrequency) {
  struct Case {
    double per_min;
    int flutes;
    double rate_hz, hz;
  };
  for (const Case& tested : {Case{2500, 2, 1000, 250.0 / 3},
                             {1200, 8, 1000, 160},
                             {10000, 8, 1000, 500.0 / 3},
                             {60000, 8, 1000, 200},
                             {60000, 8, 4000, 200}}) {
    SCOPED_TRACE(std::to_string(tested.per_min) + "/min, " + std::to_string(tested.flutes) + " flutes, " +
                 std::to_string(tested.rate_hz) + " Hz");
    Drilling drilling;
    drilling.burr = burr_of(tested.per_min, tested.flutes);
    drilling.rate_hz = tested.rate_hz;
    drilling.run();
    const std::vector<double> signal = drilling.rendered_N(1);
    double peak_hz = 0, peak_N = 0, elsewhere_N = 0;
    for (double hz = 40; hz < 0.45 * tested.rate_hz; hz += 0.25) {
      const double amplitude_N = component(signal, hz, 1 / tested.rate_hz);
      if (amplitude_N > peak_N) peak_N = amplitude_N, peak_hz = hz;
      if (std::abs(hz - tested.hz) > 10) elsewhere_N = std::max(elsewhere_N, amplitude_N);
    }
    EXPECT_NEAR(peak_hz, tested.hz, 1);
    double told_N = 0;
    for (std::size_t n = drilling.ticks.size() - signal.size(); n < drilling.ticks.size(); ++n) {
      told_N += drilling.ticks[n].vibration_N / static_cast<double>(signal.size());
      ASSERT_NEAR(drilling.ticks[n].vibration_hz, tested.hz, 1e-9);
    }
    EXPECT_NEAR(peak_N, told_N, 0.05 * told_N);
    EXPECT_GT(peak_N, 0.005);
    EXPECT_LT(elsewhere_N, 0.2 * peak_N);
  }
}

TEST(BurrVibration, IsStrongerInDenserBoneAndUnderMoreLoad) {
  const auto amplitude_N = [](double energy_mJ_per_mm3, double speed_mm_s) {
    Drilling drilling;
    drilling.energy_mJ_per_mm3 = energy_mJ_per_mm3;
    drilling.speed_mm_s = speed_mm_s;
    return component(drilling.run().rendered_N(0.5), 200, 1e-3);
  };
  double before_N = 0;
  for (const double energy : {10.0, 30.0, 100.0, 200.0}) {
    const double now_N = amplitude_N(energy, 2);
    EXPECT_GT(now_N, 1.1 * before_N) << energy;
    EXPECT_LE(now_N, kBurrRenderingSettings.max_vibration_N);
    before_N = now_N;
  }
  EXPECT_GT(amplitude_N(100, 3), amplitude_N(100, 1));
}

TEST(BurrVibration, IsOffByDefaultAndDoesNotChangeTheCut) {
  EXPECT_FALSE(Parameters{}.vibration);
  Drilling off, on, again;
  off.vibrates = false;
  off.run();
  on.run();
  again.run();
  EXPECT_EQ(on.hash, again.hash);
  EXPECT_NE(on.hash, off.hash);
  EXPECT_EQ(on.along_N, again.along_N);
  for (std::size_t n = 0; n < off.ticks.size(); ++n) {
    ASSERT_EQ(off.ticks[n].vibration_N, 0);
    ASSERT_EQ(off.ticks[n].kick_N, 0);
    ASSERT_EQ(off.ticks[n].cutting_N, on.ticks[n].cutting_N) << "a guided burr cuts the same";
    ASSERT_EQ(off.ticks[n].proxy_patient_mm, on.ticks[n].proxy_patient_mm);
  }
}

TEST(BurrVibration, StaysWithinTheRemainingForceLimit) {
  for (const double limit_N : {0.2, 0.5, 1.0}) {
    Drilling drilling;
    drilling.max_force_N = limit_N;
    drilling.speed_mm_s = 6;
    drilling.run();
    double least_N = 1;
    for (std::size_t n = 0; n < drilling.ticks.size(); ++n) {
      const DeviceTick& tick = drilling.ticks[n];
      ASSERT_LE(std::hypot(tick.force_N[0], tick.force_N[1], tick.force_N[2]), limit_N * (1 + 1e-12));
      // the contact itself reaches the limit: nothing is left
      if ((tick.flags & kFlagClamped) != 0) {
        ASSERT_EQ(tick.vibration_N, 0) << n;
        least_N = 0;
      }
    }
    EXPECT_EQ(least_N, 0) << "the test is about nothing";
  }
}

TEST(BurrVibration, IsZeroWhileTheEnergyIsNegative) {
  GuidedSession guided;
  guided.parameters.vibration = true;
  guided.lead_to(guided.above(0.2), 100);
  guided.lead_to(guided.above(-0.5), 100);
  ASSERT_GT(guided.record.device[0].vibration_N, 0);
  guided.state.device[0].passivity.energy_mJ = -1;
  guided.tick_once();
  EXPECT_EQ(guided.record.device[0].vibration_N, 0);
  EXPECT_EQ(guided.record.device[0].kick_N, 0);
}

TEST(BurrKick, RollsTheHeadClockwiseViewedFromTheHandle) {
  // the spindle points along x: on top of the ball the head rolls along y, with its sign
  for (const double sign : {1.0, -1.0}) {
    Drilling drilling;
    drilling.burr.spindle = {sign, 0, 0};
    drilling.speed_mm_s = 20;
    drilling.time_s = 0.1;
    drilling.run();
    const std::vector<double> rendered_N = drilling.rendered_N(drilling.time_s);
    double kick_N = 0, impulse_N_s = 0;
    for (std::size_t n = 0; n < rendered_N.size(); ++n) {
      kick_N = std::max(kick_N, drilling.ticks[n].kick_N);
      ASSERT_LE(std::abs(drilling.ticks[n].kick_N), kBurrRenderingSettings.max_kick_N);
      impulse_N_s += rendered_N[n] * kBurrTick_s;
    }
    EXPECT_GT(kick_N, 0.05) << "while the load grows";
    EXPECT_GT(sign * impulse_N_s, 1e-3);
  }
}

TEST(BurrKick, IsSmallAlongTheSpindle) {
  const auto largest_N = [](const Eigen::Vector3d& spindle) {
    Drilling drilling;
    drilling.burr.spindle = spindle;
    drilling.speed_mm_s = 5;
    drilling.time_s = 0.1;
    drilling.run();
    double kick_N = 0;
    for (const DeviceTick& tick : drilling.ticks) kick_N = std::max(kick_N, std::abs(tick.kick_N));
    return kick_N;
  };
  // the tool's y axis is the patient's z axis; between voxels of 1 mm the normal is some degrees off
  EXPECT_LT(largest_N({0, 1, 0}), 0.25 * largest_N({1, 0, 0}));
}

// drills towards a cavity whose roof is `wall_mm` thick, and returns the delay from the tick in which the
// foot of the head is free to the first one that reports it, in ms; -1: reported before
double report_delay_ms(const Model& model, double wall_mm, double speed_mm_s) {
  GuidedSession guided(model);
  constexpr double kCavity_mm = 4;
  const double roof_mm = kBoneRadius_mm - wall_mm;
  const std::vector<Cut> cavity{
      {1, {{-2, 0, roof_mm - kCavity_mm}, {2, 0, roof_mm - kCavity_mm}, kCavity_mm}}};
  guided.carving = guided.carving->with(cavity);
  guided.model = guided.carving->applied_to(*guided.model);
  guided.lead_to(guided.above(0.2), 100);
  int free = -1;
  for (int n = 0; n < 4000; ++n) {
    if (n % 20 == 0) guided.carve();
    guided.lead_to(guided.above(0.2 - speed_mm_s * kBurrTick_s * n), 1);
    const DeviceTick& tick = guided.record.device[0];
    const double foot_mm = tick.proxy_patient_mm[2] - kBurrRadius_mm - kCuttingSettings.lookahead_mm;
    if (free < 0 && foot_mm < roof_mm) free = n;
    if ((tick.flags & kFlagBreakThrough) != 0) return free < 0 ? -1 : n - free;
  }
  return 1e9;
}

TEST(BurrBreakThrough, IsReportedWithinTenMilliseconds) {
  const Model model = burr_model(0.5);
  for (const double wall_mm : {0.6, 2.0})
    for (const double speed_mm_s : {1.0, 10.0}) {
      const double delay_ms = report_delay_ms(model, wall_mm, speed_mm_s);
      // between voxels the roof of the cavity reads up to a twentieth of a millimetre lower
      EXPECT_LE(delay_ms, 10 + 50 / speed_mm_s) << wall_mm << " mm, " << speed_mm_s << " mm/s";
      EXPECT_GE(delay_ms, -1);
    }
}

TEST(BurrBreakThrough, IsNotReportedInSolidBoneNorWhenTheHandWithdraws) {
  GuidedSession guided;
  guided.lead_to(guided.above(0.2), 100);
  for (int n = 0; n < 600; ++n) {
    if (n % 20 == 0) guided.carve();
    guided.lead_to(guided.above(0.2 - 0.005 * n), 1);
    ASSERT_EQ(guided.record.device[0].flags & kFlagBreakThrough, 0u) << n;
  }
  ASSERT_GT(guided.burr().removed_mm3, 1);
  for (int n = 0; n < 300; ++n) {
    if (n % 20 == 0) guided.carve();
    guided.lead_to(guided.above(-2.8 + 0.02 * n), 1);
    ASSERT_EQ(guided.record.device[0].flags & kFlagBreakThrough, 0u) << n;
  }
}

TEST(BurrHeat, ApproachesTheSteadySourceAtEveryTickRate) {
  constexpr double kPower_mW = 1000, kRadius_mm = 2;
  // a hemisphere on a half-space: P / (2 pi k r)
  const double steady_K = 0.1 * kPower_mW / (2 * std::numbers::pi * 0.54 * kRadius_mm);
  double at_10_s_K = 0;
  for (const double dt_s : {1e-4, 1e-3, 4e-3}) {
    double rise_K = 0;
    for (long n = 0; n < std::lround(10 / dt_s); ++n)
      rise_K = bone_rise_K(rise_K, kRadius_mm, kPower_mW * dt_s, dt_s);
    if (at_10_s_K > 0) {
      EXPECT_NEAR(rise_K, at_10_s_K, 1e-3 * at_10_s_K) << dt_s;
    }
    at_10_s_K = rise_K;
  }
  EXPECT_GT(at_10_s_K, 0.3 * steady_K);
  double rise_K = 0;
  for (int n = 0; n < 200000; ++n) rise_K = bone_rise_K(rise_K, kRadius_mm, kPower_mW * 1e-3, 1e-3);
  EXPECT_NEAR(rise_K, steady_K, 1e-3 * steady_K);
  for (int n = 0; n < 100000; ++n) rise_K = bone_rise_K(rise_K, kRadius_mm, 0, 1e-3);
  EXPECT_LT(rise_K, 0.01 * steady_K);
}

TEST(BurrHeat, IsReportedWithoutIrrigationOnly) {
  Drilling dry, wet;
  dry.burr.irrigation = false;
  dry.vibrates = wet.vibrates = false;
  dry.run();
  wet.run();
  EXPECT_GT(dry.ticks.back().bone_rise_K, 1);
  EXPECT_EQ(wet.ticks.back().bone_rise_K, 0);
  EXPECT_EQ(dry.along_N, wet.along_N) << "it changes no force";
}

/// With PALPATE_DRAW_VIBRATION=FOLDER also draws the pictures of docs/guide/burr.md.
TEST(BurrVibration, WaveformAndSpectrumOfThreeDrillings) {
  struct Drawn {
    std::string name, style;
    double hz = 0;
    Drilling drilling;
  };
  std::vector<Drawn> drawn{{"100 mJ/mm³", "after", 200, {}},
                           {"10 mJ/mm³", "before", 200, {.energy_mJ_per_mm3 = 10}},
                           {"2500/min, 2 flutes", "after second", 250.0 / 3, {.burr = burr_of(2500, 2)}}};
  test::Chart wave("Force across the press direction", "ms", "N", 0, 60, 0.1, -0.1);
  test::Chart spectrum("Its spectrum", "Hz", "N", 0, 300, 0.1);
  for (const double ms : {0.0, 20.0, 40.0, 60.0}) wave.tick_across(ms);
  for (const double force_N : {-0.1, -0.05, 0.0, 0.05, 0.1}) wave.tick_up(force_N);
  for (const double hz : {0.0, 100.0, 200.0, 300.0}) spectrum.tick_across(hz);
  for (const double force_N : {0.0, 0.05, 0.1}) spectrum.tick_up(force_N);
  std::vector<double> peaks_N;
  for (Drawn& burr : drawn) {
    SCOPED_TRACE(burr.name);
    const std::vector<double> signal = burr.drilling.run().rendered_N(1);
    std::vector<std::array<double, 2>> samples, amplitudes;
    for (std::size_t ms = 0; ms <= 60; ++ms) samples.push_back({static_cast<double>(ms), signal[ms]});
    for (double hz = 0; hz <= 300; hz += 0.5) amplitudes.push_back({hz, component(signal, hz, 1e-3)});
    // the kick of varying cutting forces lies below
    const auto band = std::ranges::subrange(amplitudes.begin() + 80, amplitudes.end());
    const auto peak = std::ranges::max_element(band, {}, [](const auto& point) { return point[1]; });
    ASSERT_GE((*band.begin())[0], 40);
    EXPECT_NEAR((*peak)[0], burr.hz, 1);
    peaks_N.push_back((*peak)[1]);
    wave.line(burr.style, burr.name, samples);
    spectrum.line(burr.style, burr.name, amplitudes);
  }
  EXPECT_GT(peaks_N[0], 1.5 * peaks_N[1]) << "bone that takes ten times the energy";
  if (const char* folder = std::getenv("PALPATE_DRAW_VIBRATION")) {
    wave.write(std::string(folder) + "/burr-vibration.svg");
    spectrum.write(std::string(folder) + "/burr-spectrum.svg");
  }
}

}  // namespace
}  // namespace palpate
