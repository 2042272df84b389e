#include "palpate/device/pointer_driver.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <random>
#include <string>
#include <thread>
#include <vector>

#include "device/test_drivers.h"

namespace palpate {
namespace {

using testing::virtual_ns;
using testing::virtual_time;

constexpr std::int64_t kMs_ns = 1'000'000;

// samples that the servo received, with their times
struct Observed {
  std::int64_t at_ns;
  Point<Device> tip;
  double age_s;
  bool set_down;
};

// runs for a number of 1 ms ticks, every 21st of them late by three; calls `act` before each, as a page's
// thread would
// @param force_N  rendered force at a position of the tip
// @param portion  number of ticks after which the clock pauses, so that the driver's run() returns
std::vector<Observed> run(
    PointerDriver& driver, int ticks, const std::function<void(int tick)>& act,
    const std::function<double(const Point<Device>&)>& force_N = [](const auto&) { return 1e3; },
    int portion = 1 << 30) {
  class Servo final : public ServoFunction, public ServoClock {
   public:
    Servo(int ticks, const std::function<void(int)>& act,
          const std::function<double(const Point<Device>&)>& force_N, int portion)
        : ticks_(ticks), act_(act), force_N_(force_N), portion_(portion) {}
    bool wait() noexcept override {
      if (stopped()) return false;
      if (left_ == 0) {
        left_ = portion_;
        return false;
      }
      --left_;
      virtual_ns += tick_ % 21 == 20 ? 4 * kMs_ns : kMs_ns;
      act_(tick_++);
      return true;
    }
    bool stopped() const noexcept override { return tick_ == ticks_; }
    void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept override {
      const std::int64_t now_ns = virtual_ns;
      const double age_s = static_cast<double>(now_ns - samples[0].taken_ns) * 1e-9;
      seen.push_back({now_ns, samples[0].tip, age_s, samples[0].set_down});
      commands[0].force_N = Vector<Device>(force_N_(samples[0].tip), 0, 0);
    }
    std::vector<Observed> seen;

   private:
    const int ticks_;
    const std::function<void(int)>& act_;
    const std::function<double(const Point<Device>&)>& force_N_;
    const int portion_;
    int tick_ = 0, left_ = portion_;
  };
  Servo servo(ticks, act, force_N, portion);
  while (!servo.stopped()) driver.run(servo, servo);
  return servo.seen;
}

TEST(PointerDriver, HasNoForceProperties) {
  const PointerDriver driver(Point<Device>(1, 2, 3));
  const DeviceInfo& info = driver.devices()[0];
  EXPECT_TRUE(info.simulated) << "nothing can move";
  EXPECT_EQ(info.drive, DeviceInfo::Drive::kPulled);
  EXPECT_FALSE(info.peak_force_N || info.continuous_force_N || info.position_step_mm || info.workspace);
  EXPECT_EQ(info.degrees_of_freedom_out, 0);
}

TEST(PointerDriver, PoseIsInvalidBeforeTheFirstUpdate) {
  PointerDriver driver(Point<Device>(1, 2, 3), virtual_time);
  for (const Observed& observed : run(driver, 20, [](int) {})) {
    EXPECT_EQ(observed.tip, Point<Device>(1, 2, 3));
    EXPECT_GT(observed.age_s, 0.01);
  }
}

TEST(PointerDriver, InterpolatesWithoutExtrapolation) {
  // a stroke back and forth, one message every eighth tick: 0, 4, 8, ... 40, 36, ... 0 mm
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  const auto declared_mm = [](int message) { return 4.0 * (message <= 10 ? message : 20 - message); };
  // plus the longest possible interpolation, 40 ms
  const auto observed = run(driver, 220, [&](int tick) {
    if (tick % 8 == 0 && tick / 8 <= 20) {
      EXPECT_TRUE(driver.move(Point<Device>(declared_mm(tick / 8), 0, 0)).ok());
    }
  });
  double farthest_mm = 0;
  int between = 0;
  for (std::size_t n = 1; n < observed.size(); ++n) {
    const double x = observed[n].tip.x(), step_mm = std::abs(x - observed[n - 1].tip.x());
    const double dt_s = static_cast<double>(observed[n].at_ns - observed[n - 1].at_ns) * 1e-9;
    farthest_mm = std::max(farthest_mm, x);
    EXPECT_GE(x, 0);
    // 4 mm within the interval between two messages, at least 8 ms, and after a late tick additionally the
    // rest of the previous path
    EXPECT_LE(step_mm, dt_s * 1e3 + 1e-9) << n;
    between += std::fmod(x, 4) > 0.01 && std::fmod(x, 4) < 3.99;
  }
  EXPECT_LE(farthest_mm, 40 + 1e-12) << "an overshoot";
  EXPECT_GT(farthest_mm, 38) << "the way back began before it was there";
  EXPECT_GT(between, 100) << "it went in steps";
  EXPECT_EQ(observed.back().tip.x(), 0);
}

TEST(PointerDriver, PoseExpiresAfterItsValidity) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  std::int64_t moved_ns = 0;
  const auto observed = run(driver, 1000, [&](int tick) {
    if (tick != 5 && tick != 900) return;
    EXPECT_TRUE(driver.move(Point<Device>(tick == 5 ? 1 : 2, 0, 0)).ok());
    if (tick == 5) moved_ns = virtual_ns;
  });
  int fresh = 0, old = 0;
  for (std::size_t n = 5; n < observed.size(); ++n) {
    const Observed& at = observed[n];
    // correct age: time since the last message minus the time for which it is valid
    const double after_s = static_cast<double>(at.at_ns - moved_ns) * 1e-9;
    const double expected_s = n < 900 ? std::max(0.0, after_s - PointerDriver::kValidity_s) : 0;
    EXPECT_NEAR(at.age_s, expected_s, 1e-9) << n;
    (expected_s > 0 ? old : fresh) += 1;
    // the tip is stationary
    if (expected_s > 0) {
      EXPECT_EQ(at.tip, Point<Device>(1, 0, 0));
    }
  }
  EXPECT_GT(fresh, 450);
  EXPECT_GT(old, 300);
}

TEST(PointerDriver, ReleaseInvalidatesThePoseAtOnce) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  const auto observed = run(driver, 60, [&](int tick) {
    if (tick == 3) {
      EXPECT_TRUE(driver.move(Point<Device>(0, 0, 0)).ok());
    }
    if (tick == 5) {
      EXPECT_TRUE(driver.move(Point<Device>(30'000, 0, 0)).ok());
    }
    if (tick == 12) driver.release();
  });
  const Observed& last = observed.back();
  EXPECT_GT(last.age_s, 1) << "older than anything that could count";
  EXPECT_GT(last.tip.x(), 0);
  EXPECT_LT(last.tip.x(), 30'000);
  EXPECT_EQ(last.tip, observed[observed.size() - 20].tip);
}

TEST(PointerDriver, FirstPoseAfterExpiryAppliesAtOnce) {
  // released, or silent for longer than a pose is valid, and then 80 mm away
  for (const bool release : {true, false}) {
    SCOPED_TRACE(release);
    PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
    const auto observed = run(driver, 700, [&](int tick) {
      if (tick == 3) {
        EXPECT_TRUE(driver.move(Point<Device>(10, 0, 0)).ok());
      }
      if (tick == 20 && release) driver.release();
      if (tick == 670) {
        EXPECT_TRUE(driver.move(Point<Device>(90, 0, 0)).ok());
      }
    });
    for (const Observed& at : observed) {
      const double x = at.tip.x();
      EXPECT_TRUE(x == 0 || x == 10 || x == 90) << x;
    }
    EXPECT_EQ(observed.front().tip.x(), 0);
    EXPECT_EQ(observed.back().tip.x(), 90);
  }
}

TEST(PointerDriver, ATipIsSetDownAtOnceAlsoIfMessagesArriveTogether) {
  for (const bool follows : {false, true}) {
    SCOPED_TRACE(follows);
    PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
    const auto observed = run(driver, 60, [&](int tick) {
      if (tick == 3 || tick == 20) {
        EXPECT_TRUE(driver.move(Point<Device>(10, 0, 0)).ok());
      }
      if (tick != 30) return;
      EXPECT_TRUE(driver.move(Point<Device>(14, 0, 0), {}, true).ok());
      if (follows) {
        EXPECT_TRUE(driver.move(Point<Device>(14, 0, 0)).ok());
      }
    });
    EXPECT_TRUE(observed[30].set_down);
    EXPECT_EQ(std::ranges::count_if(observed, &Observed::set_down), 1);
    for (std::size_t n = 5; n < observed.size(); ++n) {
      EXPECT_EQ(observed[n].tip.x(), n < 30 ? 10 : 14) << n;
      EXPECT_LT(observed[n].age_s, 1e-3) << "there is no ramp";
    }
  }
}

TEST(PointerDriver, DistantClickIsApproachedAtLimitedSpeed) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  const auto observed = run(driver, 350, [&](int tick) {
    if (tick % 10 == 0) {
      EXPECT_TRUE(driver.move(Point<Device>(tick < 50 ? 0 : 300, 0, 0)).ok());
    }
  });
  for (std::size_t n = 1; n < observed.size(); ++n) {
    const double dt_s = static_cast<double>(observed[n].at_ns - observed[n - 1].at_ns) * 1e-9;
    const double step_mm = (observed[n].tip - observed[n - 1].tip).norm();
    EXPECT_LE(step_mm, InterpolatedPose::kMaxSpeed_mm_s * (dt_s + 1e-3)) << n;
  }
  EXPECT_EQ(observed.back().tip.x(), 300);
}

// a page's main thread is blocked 200 times for 50 to 400 ms, between keep-alive messages every 33 ms
TEST(PointerDriver, ShortPageStallsKeepThePose) {
  const auto seed = static_cast<unsigned>(::testing::UnitTest::GetInstance()->random_seed());
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  std::uniform_int_distribution<int> stall_ms(50, 400), beats(1, 5);
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  std::int64_t next_ns = virtual_ns;
  int stalls = 0, left = beats(random);
  const auto observed = run(driver, 70'000, [&](int) {
    if (virtual_ns < next_ns || stalls == 200) return;
    EXPECT_TRUE(driver.move(Point<Device>(1, 2, 3)).ok());
    const bool stalled = --left == 0;
    next_ns = virtual_ns + (stalled ? stall_ms(random) : 33) * kMs_ns;
    if (!stalled) return;
    ++stalls;
    left = beats(random);
  });
  ASSERT_EQ(stalls, 200);
  // from the first message to the last stall, whose hold may expire after the test's end
  const auto dropped = std::ranges::find_if(observed, [](const Observed& at) { return at.age_s > 1e-9; });
  ASSERT_NE(dropped, observed.end()) << "the last message expires";
  EXPECT_GT(dropped->at_ns, next_ns - 400 * kMs_ns);
}

// longer stalls: the force is gone 0.6 s after the last message; the output stage removes it within 10 ms
TEST(PointerDriver, LongPageStallExpiresThePose) {
  for (const int stall_ms : {1000, 2000, 10'000}) {
    PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
    std::int64_t last_ns = 0;
    const auto observed = run(driver, stall_ms, [&](int tick) {
      if (tick > 3) return;
      EXPECT_TRUE(driver.move(Point<Device>(1, 2, 3)).ok());
      last_ns = virtual_ns;
    });
    for (const Observed& at : observed)
      EXPECT_EQ(at.age_s > 0.01, at.at_ns - last_ns > 560 * kMs_ns) << stall_ms << " " << at.age_s;
  }
}

// a press against surfaces from soft to hard, whose height differs from the page's by up to 0.5 mm while the
// tip moves
TEST(PointerDriver, PressReachesItsForceForAnyStiffness) {
  for (const double stiffness_N_per_mm : {0.2, 1.0, 3.0, 10.0}) {
    for (const double target_N : {0.3, 1.0, 2.0}) {
      if (target_N / stiffness_N_per_mm > PointerDriver::kMaxDepth_mm - 1) continue;
      SCOPED_TRACE(std::to_string(stiffness_N_per_mm) + " N/mm, " + std::to_string(target_N) + " N");
      PointerDriver driver(Point<Device>(0, 0, 1), virtual_time);
      // the rendered surface is an undulation about z = 0 that the page does not know
      const auto force_N = [&](const Point<Device>& tip) {
        const double surface_mm = 0.5 * std::sin(tip.x() / 5);
        return std::clamp(stiffness_N_per_mm * (surface_mm - tip.z()), 0.0, 6.0);
      };
      const auto observed = run(
          driver, 3000,
          [&](int tick) {
            if (tick % 16 != 0) return;
            const Point<Device> tip(0.03 * std::max(0, tick - 500), 0, 0);
            EXPECT_TRUE(driver.move(tip, {{0, 0, -1}, target_N}).ok());
          },
          force_N);
      int outside = 0;
      double most_N = 0;
      for (std::size_t n = 500; n < observed.size(); ++n) {
        const double at_N = force_N(observed[n].tip);
        most_N = std::max(most_N, at_N);
        outside += std::abs(at_N - target_N) > 0.3 * target_N;
      }
      EXPECT_LE(outside, 25) << "ticks of 2500";
      EXPECT_LE(most_N, 2 * target_N);
    }
  }
}

TEST(PointerDriver, PressIsIndependentOfClockPauses) {
  const auto tips = [](int portion) {
    virtual_ns = 3'600'000'000'000;
    PointerDriver driver(Point<Device>(0, 0, 1), virtual_time);
    EXPECT_TRUE(driver.open(false).ok());
    const auto observed = run(
        driver, 600,
        [&](int tick) {
          if (tick % 16 == 0) {
            EXPECT_TRUE(driver.move(Point<Device>(0, 0, 0), {{0, 0, -1}, 1}).ok());
          }
        },
        [](const Point<Device>& tip) { return std::clamp(-2 * tip.z(), 0.0, 6.0); }, portion);
    std::vector<Point<Device>> observed_tips;
    for (const Observed& one : observed) observed_tips.push_back(one.tip);
    return observed_tips;
  };
  const auto whole = tips(1 << 30);
  EXPECT_NEAR(whole.back().z(), -0.5, 0.05);
  EXPECT_EQ(tips(4), whole);
}

TEST(PointerDriver, PressEndsWithoutWindup) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  // nothing to press against, then the press ends
  const auto observed = run(
      driver, 800,
      [&](int tick) {
        if (tick % 16 != 0) return;
        const auto press = tick < 400 ? PointerDriver::Press{{0, 0, -1}, 1} : PointerDriver::Press{};
        EXPECT_TRUE(driver.move(Point<Device>(0, 0, 0), press).ok());
      },
      [](const auto&) { return 0.0; });
  EXPECT_NEAR(observed[399].tip.z(), -PointerDriver::kMaxSearchDepth_mm, 1e-9);
  EXPECT_EQ(observed.back().tip, Point<Device>(0, 0, 0));
  for (std::size_t n = 1; n < observed.size(); ++n)
    EXPECT_LE((observed[n].tip - observed[n - 1].tip).norm(),
              4 * PointerDriver::kMaxPressSpeed_mm_s * 1e-3 + 1e-9);
}

TEST(PointerDriver, PoseIsConsistentAcrossThreads) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  std::atomic<int> declared{0};
  std::atomic<bool> ended{false};
  std::thread page([&] {
    for (; !ended; ++declared) {
      // a torn read would leave the diagonal
      const double x = 5 * std::sin(0.01 * declared);
      EXPECT_TRUE(driver.move(Point<Device>(x, x, x)).ok());
      std::this_thread::yield();
    }
  });
  // until both threads have alternated several hundred times
  const auto observed = run(driver, 500, [&](int tick) {
    while (declared < tick) std::this_thread::yield();
  });
  ended = true;
  page.join();
  for (const Observed& at : observed) {
    EXPECT_NEAR(at.tip.x(), at.tip.y(), 1e-12);
    EXPECT_NEAR(at.tip.x(), at.tip.z(), 1e-12);
    EXPECT_LE(std::abs(at.tip.x()), 5);
  }
}

TEST(PointerDriver, RejectsNonFinitePositionsAndKeepsTheLast) {
  PointerDriver driver(Point<Device>(0, 0, 0), virtual_time);
  const auto observed = run(driver, 40, [&](int tick) {
    if (tick == 3) {
      EXPECT_TRUE(driver.move(Point<Device>(1, 2, 3)).ok());
    }
    if (tick < 5) return;
    for (const auto& refused : {driver.move(Point<Device>(0, std::nan(""), 0)),
                                driver.move(Point<Device>(0, 0, 0), {{0, 0, 1}, std::nan("")})}) {
      ASSERT_FALSE(refused.ok());
      EXPECT_EQ(refused.error().kind, ErrorKind::kBadInput);
    }
  });
  EXPECT_EQ(observed.back().tip.eigen(), Eigen::Vector3d(1, 2, 3));
}

// half of the path has half of the rotation, along the shorter arc
TEST(InterpolatedPose, RotatesAtConstantSpeed) {
  InterpolatedPose pose{Point<Device>()};
  const auto about_z = [](double rad) {
    return Eigen::Quaterniond(Eigen::AngleAxisd(rad, Eigen::Vector3d::UnitZ()));
  };
  DeviceSample sample;
  pose.push({0, 0, 0}, about_z(0.2), 100 * kMs_ns);
  pose.fill(sample, 100 * kMs_ns);
  Eigen::Quaterniond far = about_z(0.4);
  far.coeffs() *= -1;  // the same rotation
  pose.push({10, 0, 0}, far, 120 * kMs_ns);
  pose.fill(sample, 120 * kMs_ns);
  pose.fill(sample, 130 * kMs_ns);
  EXPECT_NEAR(sample.tip.x(), 5, 1e-9);
  EXPECT_NEAR(sample.R_DeviceTool.angularDistance(about_z(0.3)), 0, 1e-7);
  pose.fill(sample, 140 * kMs_ns);
  EXPECT_NEAR(sample.R_DeviceTool.angularDistance(about_z(0.4)), 0, 1e-7);
}

}  // namespace
}  // namespace palpate
