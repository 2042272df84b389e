#include "device/pointer_driver.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <thread>
#include <vector>

#include "base/clock.h"

namespace palpate {
namespace {

constexpr std::int64_t kMs_ns = 1'000'000;

// what the servo was told, with when
struct Seen {
  std::int64_t at_ns;
  Point<Device> tip;
  double age_s;
};

// runs for so many ticks of about a millisecond; before each `act` is called, as a page's thread would
std::vector<Seen> run(PointerDriver& driver, int ticks, const std::function<void(int tick)>& act) {
  class Servo final : public ServoFunction, public ServoClock {
   public:
    Servo(int ticks, const std::function<void(int)>& act) : ticks_(ticks), act_(act) {}
    bool wait() noexcept override {
      if (stopped()) return false;
      std::this_thread::sleep_for(std::chrono::nanoseconds(kMs_ns));
      act_(tick_++);
      return true;
    }
    bool stopped() const noexcept override { return tick_ == ticks_; }
    void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
      const std::int64_t now_ns = monotonic_ns();
      seen.push_back({now_ns, samples[0].tip, static_cast<double>(now_ns - samples[0].taken_ns) * 1e-9});
      // what nothing can be pushed with
      commands[0].force_N = Vector<Device>(1e3, 0, 0);
    }
    std::vector<Seen> seen;

   private:
    const int ticks_;
    const std::function<void(int)>& act_;
    int tick_ = 0;
  };
  Servo servo(ticks, act);
  driver.run(servo, servo);
  return servo.seen;
}

bool is_fresh(const Seen& seen) {
  // a thread that lost its processor between the two looks at the clock is no fault of the driver's
  return seen.age_s < 0.05;
}

TEST(PointerDriver, KnowsNothingOfForces) {
  const PointerDriver driver(Point<Device>(1, 2, 3));
  const DeviceInfo& info = driver.devices()[0];
  EXPECT_TRUE(info.simulated) << "nothing can move";
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kPulled);
  EXPECT_FALSE(info.peak_force_N || info.continuous_force_N || info.position_step_mm || info.workspace);
  EXPECT_EQ(info.degrees_of_freedom_out, 0);
}

TEST(PointerDriver, UntilItIsMovedItsPoseIsOld) {
  PointerDriver driver(Point<Device>(1, 2, 3));
  for (const Seen& seen : run(driver, 20, [](int) {})) {
    EXPECT_EQ(seen.tip, Point<Device>(1, 2, 3));
    EXPECT_GT(seen.age_s, 0.01);
  }
}

TEST(PointerDriver, GoesEvenlyBetweenMessagesAndNeverBeyondThem) {
  // a stroke to and fro, a message every eighth tick: 0, 4, 8, ... 40, 36, ... 0 mm
  PointerDriver driver(Point<Device>(0, 0, 0));
  const auto said_mm = [](int message) { return 4.0 * (message <= 10 ? message : 20 - message); };
  // then as long as the last way takes at most, 40 ms
  const auto seen = run(driver, 220, [&](int tick) {
    if (tick % 8 == 0 && tick / 8 <= 20) driver.move(Point<Device>(said_mm(tick / 8), 0, 0));
  });
  double farthest_mm = 0;
  int between = 0;
  for (std::size_t n = 1; n < seen.size(); ++n) {
    const double x = seen[n].tip.x(), step_mm = std::abs(x - seen[n - 1].tip.x());
    const double dt_s = static_cast<double>(seen[n].at_ns - seen[n - 1].at_ns) * 1e-9;
    farthest_mm = std::max(farthest_mm, x);
    EXPECT_GE(x, 0);
    // 4 mm within an interval between two messages, which is at least 8 ms, and what a late thread has left
    // of the way before: no step, however late a tick is
    EXPECT_LE(step_mm, dt_s * 1e3 + 1 + 1e-9) << n;
    between += std::fmod(x, 4) > 0.01 && std::fmod(x, 4) < 3.99;
  }
  EXPECT_LE(farthest_mm, 40 + 1e-12) << "an overshoot";
  EXPECT_GT(farthest_mm, 30) << "where a thread came late, the way back began before it was there";
  EXPECT_GT(between, 100) << "it went in steps";
  EXPECT_LT(seen.back().tip.x(), 0.5);
}

TEST(PointerDriver, APoseHoldsForATenthOfASecondAndThenGrowsOld) {
  PointerDriver driver(Point<Device>(0, 0, 0));
  std::int64_t moved_ns = 0, again_ns = 0;
  const auto seen = run(driver, 400, [&](int tick) {
    if (tick == 5) {
      driver.move(Point<Device>(1, 0, 0));
      moved_ns = monotonic_ns();
    }
    if (tick == 300) {
      driver.move(Point<Device>(2, 0, 0));
      again_ns = monotonic_ns();
    }
  });
  int held = 0, fresh = 0, old = 0, again = 0;
  for (const Seen& at : seen) {
    const double after_s = static_cast<double>(at.at_ns - moved_ns) * 1e-9;
    if (at.at_ns >= again_ns) {
      again += is_fresh(at);
    } else if (at.at_ns >= moved_ns) {
      const bool holds = after_s < PointerDriver::kHeld_s - 0.02;
      held += holds;
      fresh += holds && is_fresh(at);
      if (after_s <= PointerDriver::kHeld_s) continue;
      // truthful: as old as the last word, less what that holds
      EXPECT_NEAR(at.age_s, after_s - PointerDriver::kHeld_s, 2e-3);
      // and the tip rests
      EXPECT_EQ(at.tip, Point<Device>(1, 0, 0));
      ++old;
    }
  }
  // how many ticks fit into a tenth of a second is the machine's affair
  EXPECT_GT(fresh, 0);
  EXPECT_GE(fresh, held - 1);
  EXPECT_GT(old, 50);
  EXPECT_GT(again, 0) << "it does not come back";
}

TEST(PointerDriver, LetGoItIsOldAtOnceAndRestsWhereItIs) {
  PointerDriver driver(Point<Device>(0, 0, 0));
  const auto seen = run(driver, 60, [&](int tick) {
    if (tick == 3) driver.move(Point<Device>(0, 0, 0));
    // so far that no thread is late enough to get there
    if (tick == 5) driver.move(Point<Device>(30'000, 0, 0));
    if (tick == 12) driver.release();
  });
  const Seen& last = seen.back();
  EXPECT_GT(last.age_s, 1) << "older than anything that could count";
  EXPECT_GT(last.tip.x(), 0);
  EXPECT_LT(last.tip.x(), 30'000);
  EXPECT_EQ(last.tip, seen[seen.size() - 20].tip);
}

TEST(PointerDriver, WhoComesBackIsThereAtOnce) {
  // let go, or silent for longer than a pose holds, and then 80 mm away
  for (const bool let_go : {true, false}) {
    SCOPED_TRACE(let_go);
    PointerDriver driver(Point<Device>(0, 0, 0));
    const auto seen = run(driver, 200, [&](int tick) {
      if (tick == 3) driver.move(Point<Device>(10, 0, 0));
      if (tick == 20 && let_go) driver.release();
      if (tick == 170) driver.move(Point<Device>(90, 0, 0));
    });
    for (const Seen& at : seen) {
      const double x = at.tip.x();
      EXPECT_TRUE(x == 0 || x == 10 || x == 90) << x;
    }
    EXPECT_EQ(seen.front().tip.x(), 0);
    EXPECT_EQ(seen.back().tip.x(), 90);
  }
}

TEST(PointerDriver, AClickElsewhereIsAWayAndNoJump) {
  PointerDriver driver(Point<Device>(0, 0, 0));
  const auto seen = run(driver, 350, [&](int tick) {
    if (tick % 10 == 0) driver.move(Point<Device>(tick < 50 ? 0 : 300, 0, 0));
  });
  for (std::size_t n = 1; n < seen.size(); ++n) {
    const double dt_s = static_cast<double>(seen[n].at_ns - seen[n - 1].at_ns) * 1e-9;
    const double step_mm = (seen[n].tip - seen[n - 1].tip).norm();
    EXPECT_LE(step_mm, PointerDriver::kMostSpeed_mm_s * (dt_s + 1e-3)) << n;
  }
  EXPECT_EQ(seen.back().tip.x(), 300);
}

TEST(PointerDriver, ComesFromAnotherThreadAtAnyTime) {
  PointerDriver driver(Point<Device>(0, 0, 0));
  std::atomic<bool> ended{false};
  std::thread page([&] {
    for (int n = 0; !ended; ++n) {
      // the coordinates belong together: a torn one would leave the diagonal
      const double x = 5 * std::sin(0.01 * n);
      driver.move(Point<Device>(x, x, x));
      std::this_thread::yield();
    }
  });
  const auto seen = run(driver, 100, [](int) {});
  ended = true;
  page.join();
  for (const Seen& at : seen) {
    EXPECT_NEAR(at.tip.x(), at.tip.y(), 1e-12);
    EXPECT_NEAR(at.tip.x(), at.tip.z(), 1e-12);
    EXPECT_LE(std::abs(at.tip.x()), 5);
  }
}

TEST(PointerDriver, APlaceThatIsNoNumberIsABug) {
  PointerDriver driver(Point<Device>(0, 0, 0));
  EXPECT_DEATH(driver.move(Point<Device>(0, std::nan(""), 0)), "finite");
}

}  // namespace
}  // namespace palpate
