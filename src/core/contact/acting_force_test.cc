#include "palpate/contact/acting_force.h"

#include <gtest/gtest.h>

#include <cmath>
#include <deque>
#include <random>

namespace palpate {
namespace {

TEST(ActingForce, WithoutDelayEqualsTheCommand) {
  DelayLine line;
  EXPECT_EQ(advance_delay_line(Vector<World>(1, 2, 3), 1e-3, 0, line), Vector<World>(1, 2, 3));
  EXPECT_EQ(line.count, 0);
  EXPECT_EQ(pending_impulse_N_s(line, Vector<World>(1, 0, 0), 0), 0);
}

TEST(ActingForce, IsTheMeanActingForceForAnyTickLength) {
  // reference: commands on a fine time axis, shifted by the delay
  constexpr double kFine_s = 1e-5;
  for (const double delay_s : {0.2e-3, 1e-3, 3e-3, 7e-3}) {
    std::mt19937 random(5);
    std::uniform_real_distribution<double> force(-2, 2);
    std::deque<double> delayed(static_cast<std::size_t>(std::lround(delay_s / kFine_s)), 0.0);
    DelayLine line;
    for (int n = 0; n < 400; ++n) {
      const int fine = 50 + static_cast<int>(random() % 100);
      const double sent = force(random);
      for (int i = 0; i < fine; ++i) delayed.push_back(sent);
      double acted = 0, pending = 0;
      for (int i = 0; i < fine; ++i) {
        acted += delayed.front() / fine;
        delayed.pop_front();
      }
      for (const double later : delayed) pending += later * kFine_s;
      const double reported =
          advance_delay_line(Vector<World>(0, sent, 0), fine * kFine_s, delay_s, line).y();
      ASSERT_NEAR(reported, acted, 1e-9) << n;
      ASSERT_NEAR(pending_impulse_N_s(line, Vector<World>(0, 1, 0), delay_s), pending, 1e-12) << n;
    }
  }
}

// The delay changes from tick to tick with late ticks and detected oscillations; the impulse must be
// conserved.
TEST(ActingForce, ConstantForceIsPreservedWhenTheDelayChanges) {
  for (const double min_s : {0.0, 1e-3, 4e-3})
    for (const double tick_s : {1e-4, 1e-3, 4e-3}) {
      std::mt19937 random(7);
      std::uniform_real_distribution<double> longer(0, 6e-3), part(0.5, 1.5);
      DelayLine line;
      double time_s = 0;
      for (int n = 0; n < 1000; ++n) {
        const double dt_s = n % 50 == 49 ? 8 * tick_s : tick_s * part(random);
        const double delay_s = min_s + (n % 3 == 0 ? longer(random) : 0);
        const Vector<World> acted = advance_delay_line(Vector<World>(0, 0, 2), dt_s, delay_s, line);
        // after the delay has passed
        if (time_s > min_s + 10e-3) {
          ASSERT_NEAR(acted.z(), 2, 1e-9) << n << ": " << delay_s << " s, tick of " << dt_s;
        }
        time_s += dt_s;
      }
    }
}

TEST(ActingForce, FullDelayLineDropsTheOldest) {
  DelayLine line;
  for (int n = 0; n < 1000; ++n) {
    const Vector<World> acted = advance_delay_line(Vector<World>(1, 0, 0), 1e-4, 20e-3, line);
    ASSERT_TRUE(acted.all_finite());
    if (n > 200) {
      ASSERT_NEAR(acted.x(), 1, 1e-9) << "what it still knows stands for that";
    }
    ASSERT_LE(line.count, static_cast<int>(line.samples.size()));
  }
}

}  // namespace
}  // namespace palpate
