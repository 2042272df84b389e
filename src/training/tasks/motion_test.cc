#include "palpate/tasks/motion.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <random>

namespace palpate {
namespace {

constexpr std::array kMotionRates_Hz{1000.0, 4000.0, 10000.0};

template <class Trajectory>
MotionMeter measured(double rate_hz, double length_s, const Trajectory& section, bool touching = false) {
  MotionMeter meter;
  const auto count = static_cast<long>(std::lround(length_s * rate_hz));
  for (long n = 0; n <= count; ++n) {
    const double t = static_cast<double>(n) / rate_hz;
    meter.observe(t, section(t), touching);
  }
  return meter;
}

Eigen::Vector3d circle(double t, double radius_mm, double hz) {
  const double a = 2 * std::numbers::pi * hz * t;
  return {radius_mm * std::cos(a), radius_mm * std::sin(a), 3};
}

// reference: the same equation integrated in steps small enough for the order of the method not to matter
TEST(LowPass, IsTheSolutionOfItsEquation) {
  std::mt19937_64 random(11);
  std::normal_distribution<double> normal;
  LowPass filter;
  Eigen::Vector3d u(1, -2, 3), x = u, v = Eigen::Vector3d::Zero();
  filter.begin(u);
  const double omega = 2 * std::numbers::pi * LowPass::kCutoff_Hz;
  for (int n = 0; n < 50; ++n) {
    const Eigen::Vector3d next = u + Eigen::Vector3d(normal(random), normal(random), normal(random));
    const double dt_s = 0.0002 + 0.02 * std::abs(normal(random));
    constexpr int kSteps = 20000;
    const double h = dt_s / kSteps;
    const Eigen::Vector3d during = filter.position_during(next, dt_s, dt_s / 2);
    Eigen::Vector3d halfway;
    for (int s = 0; s < kSteps; ++s) {
      if (s == kSteps / 2) halfway = x;
      const Eigen::Vector3d in = u + (next - u) * ((s + 0.5) / kSteps);
      // midpoint rule
      const Eigen::Vector3d vm = v + 0.5 * h * (omega * omega * (in - x) - std::numbers::sqrt2 * omega * v);
      const Eigen::Vector3d xm = x + 0.5 * h * v;
      v += h * (omega * omega * (in - xm) - std::numbers::sqrt2 * omega * vm);
      x += h * vm;
    }
    filter.advance(next, dt_s);
    EXPECT_LT((filter.position() - x).norm(), 1e-5) << n;
    EXPECT_LT((filter.velocity() - v).norm(), 1e-3) << n;
    EXPECT_LT((during - halfway).norm(), 1e-5) << n;
    u = next;
  }
}

TEST(Motion, MeasuresACircle) {
  // point on a circle: path R w T; jerk R w^3 and speed R w throughout, so that the dimensionless jerk is (w
  // T)^4
  constexpr double kRadius_mm = 10, kHz = 0.5, kLength_s = 80;
  const double omega = 2 * std::numbers::pi * kHz;
  for (const double rate_hz : kMotionRates_Hz) {
    const MotionMeter meter =
        measured(rate_hz, kLength_s, [&](double t) { return circle(t, kRadius_mm, kHz); });
    EXPECT_NEAR(meter.path_mm() / (kRadius_mm * omega * kLength_s), 1, 1e-3) << rate_hz;
    const double closed = -4 * std::log(omega * (kLength_s - MotionMeter::kSettled_s));
    EXPECT_NEAR(meter.smoothness() / closed, 1, 1e-3) << rate_hz;
  }
}

TEST(Motion, AMoveOfLeastJerkHasItsDimensionlessJerk) {
  // x = L (10 s^3 - 15 s^4 + 6 s^5): integral of jerk squared 720 L^2 / T^5, peak speed 1.875 L / T
  constexpr double kLength_s = 40, kDistance_mm = 300;
  for (const double rate_hz : kMotionRates_Hz) {
    const MotionMeter meter = measured(rate_hz, kLength_s, [&](double t) {
      const double s = std::clamp(t / kLength_s, 0.0, 1.0);
      return Eigen::Vector3d(kDistance_mm * s * s * s * (10 - 15 * s + 6 * s * s), 0, 0);
    });
    EXPECT_NEAR(meter.path_mm(), kDistance_mm, 1e-3 * kDistance_mm);
    // jerk is only accumulated after the settling time: subtract the first 0.3 s
    const double sigma = MotionMeter::kSettled_s / kLength_s;
    const auto integral_to = [](double s) {  // integral of (60 - 360 s + 360 s^2)^2
      return 3600 * s - 21600 * s * s + 57600 * s * s * s - 64800 * s * s * s * s + 25920 * s * s * s * s * s;
    };
    const double T = kLength_s - MotionMeter::kSettled_s;
    const double closed = -std::log(T * T * T / (1.875 * 1.875) * (integral_to(1) - integral_to(sigma)) /
                                    (kLength_s * kLength_s * kLength_s));
    EXPECT_NEAR(integral_to(1), 720, 1e-9);
    EXPECT_NEAR(meter.smoothness() / closed, 1, 1e-3) << rate_hz;
  }
}

TEST(Motion, AnEncodersFlickerIsNoWay) {
  // a resting tip that jitters by 0.03 mm: 30 mm/s of path length without the filter
  std::mt19937_64 random(5);
  double unfiltered = 0, last = 0;
  MotionMeter meter;
  for (int n = 0; n < 20000; ++n) {
    const double x = (random() & 1) ? 0.03 : 0;
    unfiltered += std::abs(x - last);
    last = x;
    meter.observe(n / 1000.0, {x, 0, 0}, false);
  }
  EXPECT_GT(unfiltered, 250);
  EXPECT_LT(meter.path_mm(), 0.08 * unfiltered);
  EXPECT_NEAR(meter.idle_s(), 20, 0.1);
}

TEST(Motion, IdleIsRestInTheAir) {
  const auto path = [](double t) { return Eigen::Vector3d(t < 2 ? 0 : t < 5 ? 20 * (t - 2) : 60, 0, 0); };
  for (const double rate_hz : kMotionRates_Hz) {
    EXPECT_NEAR(measured(rate_hz, 10, path).idle_s(), 7, 0.05);
    EXPECT_EQ(measured(rate_hz, 10, path, true).idle_s(), 0);
  }
}

TEST(Motion, WithoutMotionThereIsNoSmoothness) {
  EXPECT_TRUE(std::isnan(MotionMeter().smoothness()));
  EXPECT_TRUE(std::isnan(measured(1000, 5, [](double) { return Eigen::Vector3d(1, 2, 3); }).smoothness()));
  EXPECT_TRUE(std::isnan(measured(1000, 0.4, [](double t) { return circle(t, 3, 1); }).smoothness()));
}

TEST(Motion, AGapOfHoursTakesNoHours) {
  MotionMeter meter;
  meter.observe(0, {0, 0, 0}, false);
  meter.observe(0.001, {1, 0, 0}, false);
  meter.observe(1e9, {2, 0, 0}, false);
  // motion after the gap is evaluated again
  for (int n = 1; n <= 2000; ++n) meter.observe(1e9 + n * 0.01, {2 + std::sin(n * 0.1), 0, 0}, false);
  EXPECT_TRUE(std::isfinite(meter.smoothness()));
  EXPECT_TRUE(std::isfinite(meter.path_mm()));
}

}  // namespace
}  // namespace palpate
