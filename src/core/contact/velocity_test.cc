#include <gtest/gtest.h>

#include <random>

#include "palpate/base/hash.h"
#include "palpate/contact/velocity.h"

namespace palpate {
namespace {

TEST(VelocityWindow, IsZeroBeforeTheFirstPushAndAfterClear) {
  VelocityWindow window;
  EXPECT_EQ(window.velocity_mm_s(), Vector<Patient>());
  window.push(Vector<Patient>(1, 0, 0), 1e-3);
  EXPECT_NE(window.velocity_mm_s(), Vector<Patient>());
  window.clear();
  EXPECT_EQ(window.velocity_mm_s(), Vector<Patient>());
}

TEST(VelocityWindow, IsTheMeanOfTheLastTenMilliseconds) {
  std::mt19937 random(20260101);
  std::uniform_real_distribution<double> step(-0.2, 0.2);
  for (const double rate_hz : {250.0, 1000.0, 4000.0, 10000.0}) {
    const int window_ticks = static_cast<int>(std::ceil(0.01 * rate_hz - 1e-3));
    VelocityWindow window;
    std::vector<Vector<Patient>> all;
    for (int n = 0; n < 400; ++n) {
      all.emplace_back(step(random), step(random), step(random));
      window.push(all.back(), 1 / rate_hz);
      Vector<Patient> sum;
      const int from = std::max(0, n + 1 - std::max(1, window_ticks));
      for (int i = from; i <= n; ++i) sum += all[i];
      const Vector<Patient> expected = sum * (rate_hz / (n + 1 - from));
      ASSERT_LT((window.velocity_mm_s() - expected).norm(), 1e-9) << rate_hz << " Hz, tick " << n;
    }
  }
}

TEST(VelocityWindow, SmoothsEncoderSteps) {
  // 5 mm/s quantised to steps of 0.03 mm at 1 kHz: one-tick differences are 0 or 30 mm/s
  VelocityWindow window;
  double previous = 0, worst = 0;
  for (int n = 1; n < 1000; ++n) {
    const double read = std::floor(5e-3 * n / 0.03) * 0.03;
    window.push(Vector<Patient>(read - previous, 0, 0), 1e-3);
    previous = read;
    if (n > 10) worst = std::max(worst, std::abs(window.velocity_mm_s().x() - 5));
  }
  EXPECT_LE(worst, 0.03 / 0.01 + 1e-9) << "at most one encoder step over the window";
}

TEST(VelocityWindow, WeightsTicksByTheirLength) {
  VelocityWindow window;
  window.push(Vector<Patient>(1, 0, 0), 0.002);
  window.push(Vector<Patient>(3, 0, 0), 0.006);
  EXPECT_NEAR(window.velocity_mm_s().x(), 500, 1e-9);
  // a stalled tick longer than the window is the only one in it
  window.push(Vector<Patient>(0, 5, 0), 0.05);
  EXPECT_NEAR(window.velocity_mm_s().y(), 100, 1e-9);
  EXPECT_NEAR(window.velocity_mm_s().x(), 0, 1e-9);
}

TEST(VelocityWindow, HashCoversEveryPushSinceClear) {
  const auto hash_of = [](const VelocityWindow& window) {
    std::uint64_t hash = kHashSeed;
    window.hash_into(hash);
    return hash;
  };
  VelocityWindow one, other;
  for (int n = 0; n < 300; ++n) one.push(Vector<Patient>(0.5, 0, 0), 1e-3);
  one.clear();
  for (int n = 0; n < 10; ++n) {
    one.push(Vector<Patient>(0.5, 0, 0), 1e-3);
    other.push(Vector<Patient>(0.5, 0, 0), 1e-3);
  }
  EXPECT_EQ(hash_of(one), hash_of(other));
  other.push(Vector<Patient>(0.5, 0, 1e-300), 1e-3);
  one.push(Vector<Patient>(0.5, 0, 0), 1e-3);
  EXPECT_NE(hash_of(one), hash_of(other)) << "though the velocities are equal";
}

TEST(VelocityWindow, KeepsItsPrecisionOverHours) {
  // ten hours of tremor at 1 kHz, compressed: the sums grow, differences stay exact to a nanometre
  VelocityWindow window;
  window.push(Vector<Patient>(0, 0, 0), 36000);
  for (int n = 0; n < 2000000; ++n) window.push(Vector<Patient>(n % 2 ? -0.3 : 0.3, 1e-3, 0), 1e-3);
  EXPECT_NEAR(window.velocity_mm_s().y(), 1, 1e-6);
  EXPECT_NEAR(window.velocity_mm_s().x(), 0, 1e-6);
}

}  // namespace
}  // namespace palpate
