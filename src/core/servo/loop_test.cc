#include "servo/loop.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cmath>
#include <functional>
#include <thread>

#include "base/test_processors.h"
#include "base/test_wait.h"
#include "contact/test_model.h"
#include "palpate/device/bounds.h"
#include "palpate/device/simulated_device.h"

namespace palpate {
namespace {

using namespace std::chrono_literals;
using testing::ball_model;
using testing::kBoneRadius_mm;

std::shared_ptr<const Model> ball(std::uint32_t version = 1, double stiffer = 1) {
  Model model = ball_model({1, 1, 1});
  model.version = version;
  testing::set_full_force(model, stiffer * model.methods[0]->full_force_N());
  return std::make_shared<const Model>(std::move(model));
}

DeviceInfo plain_device() {
  DeviceInfo info;
  info.name = "test";
  info.simulated = true;
  info.peak_force_N = 8;
  return info;
}

// a driver whose run() is supplied by the test
class TestDriver : public DeviceDriver {
 public:
  using Body = std::function<void(TestDriver&, ServoFunction&, ServoClock&)>;
  explicit TestDriver(Body body) : body_(std::move(body)) {}

  std::span<const DeviceInfo> devices() const override { return {&info, 1}; }
  Result<void> open(bool may_move) override { return require_consent(info, may_move); }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override { body_(*this, servo, clock); }
  void halt() noexcept override { halted_ns = monotonic_ns(); }
  void resume(std::uint64_t /*newest*/) noexcept override { resumed_ns = monotonic_ns(); }

  // one tick with the tip at that position
  DeviceCommand tick_at(ServoFunction& servo, const Point<Device>& tip) {
    DeviceSample sample;
    sample.tip = tip;
    sample.taken_ns = monotonic_ns();
    DeviceCommand command;
    servo.update({&sample, 1}, {&command, 1});
    return command;
  }

  DeviceInfo info = plain_device();
  std::atomic<std::int64_t> halted_ns{0}, resumed_ns{0};

 private:
  Body body_;
};

// keeps the tip on the ball until stopped and records every command
struct Resting {
  std::vector<double> forces_N;
  TestDriver driver{[this](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    while (clock.wait())
      forces_N.push_back(self.tick_at(servo, Point<Device>(kBoneRadius_mm, 0, 0)).force_N.norm());
  }};
};

std::unique_ptr<ServoLoop> started(DeviceDriver& driver, const LoopSettings& settings = {},
                                   std::shared_ptr<const Model> model = ball()) {
  auto loop = ServoLoop::start(std::move(model), driver, {}, {WorkspaceSettings{}}, settings);
  EXPECT_TRUE(loop.ok()) << (loop.ok() ? "" : loop.error().message());
  return std::move(*loop);
}

// after a stall of the machine the watchdog is right to halt the device, and a stale pose is right to lose
// force
bool undisturbed(const TickRecord& before, const TickRecord& record) {
  constexpr std::uint32_t disturbed = kFaultFlags | kFlagStale | kFlagSlew;
  return ((before.device[0].flags | record.device[0].flags) & disturbed) == 0;
}

void wait_until(const std::function<bool()>& done) {
  EXPECT_TRUE(testing::soon(done));
}

TEST(Loop, TicksOnItsClockAndCountsThem) {
  // times at which a wait was entered and left, on this thread's clock; any delay lies in between
  struct Wait {
    std::int64_t entered_ns = 0, left_ns = 0;
  };
  Wait first, last;
  std::uint64_t ticks = 0;
  TestDriver driver([&](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    Wait wait{.entered_ns = monotonic_ns()};
    while (clock.wait()) {
      wait.left_ns = monotonic_ns();
      if (ticks++ == 0) first = wait;
      last = wait;
      self.tick_at(servo, Point<Device>(kBoneRadius_mm, 0, 0));
      wait = {.entered_ns = monotonic_ns()};
    }
  });
  const auto loop = started(driver, {.rate_hz = 2000, .ring_s = 10});
  wait_until([&] { return loop->health().ticks > 500; });
  loop->stop();
  const LoopHealth health = loop->health();
  EXPECT_EQ(health.ticks, ticks);
  EXPECT_EQ(loop->snapshot().tick + 1, health.ticks);
  EXPECT_GT(health.compute.p50_us, 0);
  EXPECT_LE(health.lateness.p50_us, health.lateness.p99_us);
  EXPECT_FALSE(loop->scheduling().scheduler.empty());
  EXPECT_FALSE(loop->running());

  // every tick was recorded in order, with its times
  std::vector<TickRecord> records(health.ticks + 1);
  ASSERT_EQ(loop->ring().pop(records), health.ticks);
  double time_s = 0;
  for (std::size_t n = 0; n < health.ticks; ++n) {
    EXPECT_EQ(records[n].tick, n);
    EXPECT_NEAR(records[n].time_s, time_s, 1e-9);
    EXPECT_GT(records[n].compute_s, 0);
    time_s += records[n].dt_s;
  }
  // Every grid point has a tick or is counted as skipped. The grid starts when the first wait is entered, one
  // period before its first point; the last point lies after the entry and before the end of the last wait.
  constexpr double kPeriod_ns = 1e9 / 2000;
  const auto points = static_cast<double>(health.ticks + health.skipped);
  EXPECT_LE(points, static_cast<double>(last.left_ns - first.entered_ns) / kPeriod_ns + 0.01);
  EXPECT_GE(points, static_cast<double>(last.entered_ns - first.left_ns) / kPeriod_ns + 1 - 0.01);
}

TEST(Loop, ForceFadesOutBeforeItStops) {
  Resting resting;
  const auto loop = started(resting.driver, {.ring_s = 10});
  // full force, also if a stall caused it to ramp in again
  wait_until([&] {
    const DeviceTick now = loop->snapshot().device[0];
    return std::abs(now.force_N[0]) > 0.5 && (now.flags & kFlagRamp) == 0;
  });
  loop->stop();
  const double full_N = *std::max_element(resting.forces_N.begin(), resting.forces_N.end());
  EXPECT_EQ(resting.forces_N.back(), 0);
  // no step larger than the ramp or, after a late tick, the slew allows
  std::vector<TickRecord> records(resting.forces_N.size());
  records.resize(loop->ring().pop(records));
  // a thread that is not scheduled for long stops a loop whose ring is full
  ASSERT_EQ(records.size() + loop->health().dropped, resting.forces_N.size());
  for (std::size_t n = 1; n < records.size(); ++n) {
    if (!undisturbed(records[n - 1], records[n])) continue;
    const double fade = records[n].dt_s / 0.1 * full_N * 1.01;
    ASSERT_LE(std::abs(resting.forces_N[n] - resting.forces_N[n - 1]), fade + 1e-9) << n;
  }
}

TEST(Loop, ParameterChangesApplyExceptDeviceProperties) {
  Resting resting;
  const auto loop = started(resting.driver);
  EXPECT_EQ(loop->parameters().device[0].limits.peak_force_N, 8);
  EXPECT_EQ(loop->snapshot().settings_number, 0u);
  const std::uint32_t number = loop->change([](Parameters& parameters) {
    parameters.friction = false;
    parameters.max_force_N = 0.25;
    parameters.device[0].limits.peak_force_N = 100;
    parameters.device[0].force_gain = 7;
  });
  wait_until([&] { return loop->snapshot().max_force_N == 0.25; });
  const TickRecord tick = loop->snapshot();
  EXPECT_EQ(number, 1u);
  EXPECT_EQ(tick.settings_number, 1u);
  EXPECT_FALSE(tick.switches & kSwitchFriction);
  EXPECT_EQ(tick.device[0].peak_force_N, 8) << "a caller cannot raise a device's limit";
  EXPECT_EQ(tick.device[0].force_gain, 1);
  loop->stop();
}

TEST(Loop, EmergencyStopHoldsUntilItIsRearmed) {
  // moves away from the ball while stopped, and back afterwards
  std::vector<double> forces_N;
  std::atomic<bool> away{false};
  TestDriver driver([&](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    double x_mm = kBoneRadius_mm;
    while (clock.wait()) {
      x_mm = std::clamp(x_mm + (away ? 0.2 : -0.2), kBoneRadius_mm, kBoneRadius_mm + 8);
      forces_N.push_back(self.tick_at(servo, Point<Device>(x_mm, 0, 0)).force_N.norm());
    }
  });
  const auto loop = started(driver, {.ring_s = 10});
  wait_until([&] { return std::abs(loop->snapshot().device[0].force_N[0]) > 0.3; });
  const std::uint32_t first = loop->emergency_stop();
  wait_until([&] { return (loop->snapshot().device[0].flags & kFlagEmergencyStop) != 0; });
  EXPECT_EQ(loop->snapshot().device[0].force_N[0], 0);
  std::uint32_t number = 0;
  EXPECT_EQ(loop->rearm(first, number), RearmResult::kTouching);
  // stopping a stopped loop only stops
  const std::uint32_t second = loop->emergency_stop();
  EXPECT_GT(second, first);
  away = true;
  wait_until([&] { return (loop->snapshot().device[0].flags & kFlagContact) == 0; });
  EXPECT_EQ(loop->rearm(first, number), RearmResult::kStoppedAgain);
  std::this_thread::sleep_for(20ms);
  EXPECT_TRUE(loop->arming().stopped);
  EXPECT_TRUE(loop->snapshot().switches & kSwitchEmergencyStop);
  EXPECT_EQ(number, 0u);
  EXPECT_EQ(loop->rearm(second, number), RearmResult::kDone);
  EXPECT_GT(number, second);
  EXPECT_EQ(loop->rearm(second, number), RearmResult::kNotStopped);
  away = false;
  wait_until([&] { return std::abs(loop->snapshot().device[0].force_N[0]) > 0; });
  loop->stop();
  // the first force after the stop ramps in, independent of this thread's timing
  std::vector<TickRecord> records(forces_N.size());
  ASSERT_EQ(loop->ring().pop(records), records.size());
  const auto stopped = std::find_if(records.begin(), records.end(), [](const TickRecord& record) {
    return (record.device[0].flags & kFlagEmergencyStop) != 0;
  });
  const auto again = std::find_if(stopped, records.end(),
                                  [](const TickRecord& record) { return record.device[0].force_N[0] != 0; });
  ASSERT_NE(again, records.end());
  EXPECT_TRUE(again->device[0].flags & kFlagRamp);
}

// a hanging tick, as a vendor's call or a page fault on a failing disk can cause
TEST(Loop, WatchdogHaltsAndResumesADeviceWhoseServoHangs) {
  // times of the last tick before it, of the halt during it, and of its end
  std::atomic<std::int64_t> tick_ns{0}, halted_ns{0}, hang_ended_ns{0};
  std::atomic<bool> hang{false};
  TestDriver driver([&](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    std::int64_t last_ns = 0;
    while (clock.wait()) {
      // not while the device is halted by a stall of the machine itself
      if (self.resumed_ns >= self.halted_ns && hang.exchange(false)) {
        tick_ns = last_ns;
        std::this_thread::sleep_for(50ms);
        wait_until([&] { return self.halted_ns > last_ns; });
        halted_ns = self.halted_ns.load();
        hang_ended_ns = monotonic_ns();
      }
      last_ns = monotonic_ns();
      self.tick_at(servo, Point<Device>(kBoneRadius_mm, 0, 0));
    }
  });
  const auto loop = started(driver, {.ring_s = 10});
  wait_until([&] { return std::abs(loop->snapshot().device[0].force_N[0]) > 0.5; });
  const std::uint64_t before = loop->health().stalls;
  hang = true;
  wait_until([&] { return hang_ended_ns != 0; });
  EXPECT_GE(halted_ns - tick_ns, kStall_ns);
  EXPECT_LT(halted_ns, hang_ended_ns) << "while it hung";
  EXPECT_GT(loop->health().stalls, before);

  // ticks after the hang send nothing while the device is halted, then ramp in
  wait_until([&] { return driver.resumed_ns > hang_ended_ns; });
  wait_until([&] { return std::abs(loop->snapshot().device[0].force_N[0]) > 0.5; });
  loop->stop();
  std::vector<TickRecord> records(16384);
  records.resize(loop->ring().pop(records));
  bool halted = false;
  for (const TickRecord& record : records) {
    if ((record.device[0].flags & kFlagHalted) == 0) continue;
    EXPECT_EQ(record.device[0].force_N, (std::array<double, 3>{}));
    halted = true;
  }
  EXPECT_TRUE(halted);
}

TEST(Loop, ModelsAreReplacedInContactAndFreedOffTheServoThread) {
  std::atomic<std::thread::id> servo_thread;
  std::vector<double> forces_N;
  TestDriver driver([&](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    servo_thread = std::this_thread::get_id();
    while (clock.wait())
      forces_N.push_back(self.tick_at(servo, Point<Device>(kBoneRadius_mm, 0, 0)).force_N.norm());
  });
  std::atomic<int> freed{0}, freed_by_servo{0};
  const auto watched = [&](std::shared_ptr<const Model> model) {
    const Model* raw = model.get();
    return std::shared_ptr<const Model>(raw, [&, model](const Model*) mutable {
      ++freed;
      if (std::this_thread::get_id() == servo_thread.load()) ++freed_by_servo;
      model.reset();
    });
  };
  const auto loop = started(driver, {.rate_hz = 4000, .ring_s = 10}, watched(ball(1)));
  // popped continuously: on a busy machine more ticks pass than the ring can hold
  std::vector<TickRecord> records, taken(4096);
  const auto read_records = [&] {
    // until it was empty once: a thread slower than the loop would never find it empty permanently
    for (std::size_t count = taken.size(); count == taken.size();) {
      count = loop->ring().pop(taken);
      records.insert(records.end(), taken.begin(), taken.begin() + static_cast<std::ptrdiff_t>(count));
    }
  };
  wait_until([&] {
    read_records();
    return loop->snapshot().time_s > 0.6;
  });
  // alternately soft and stiff, faster than a blend
  for (std::uint32_t version = 2; version <= 20; ++version) {
    ASSERT_TRUE(loop->set_model(watched(ball(version, version % 2 ? 1 : 0.5))).ok());
    std::this_thread::sleep_for(20ms);
    read_records();
  }
  wait_until([&] { return loop->snapshot().model_version == 20; });
  wait_until([&] { return loop->collect() == 1; });
  EXPECT_EQ(freed, 19);
  EXPECT_EQ(freed_by_servo, 0);
  loop->stop();

  read_records();
  // if this thread is not scheduled for long, the ring overflows and records are dropped
  ASSERT_EQ(records.size() + loop->health().dropped, forces_N.size());
  std::uint32_t version = 1;
  for (std::size_t n = 1; n < records.size(); ++n) {
    ASSERT_GE(records[n].model_version, version) << "versions only go forward";
    version = records[n].model_version;
    const std::uint64_t tick = records[n].tick;
    ASSERT_LT(tick, forces_N.size());
    if (records[n - 1].tick + 1 != tick || !undisturbed(records[n - 1], records[n])) continue;
    // steps of the requested force, about 3.2 N, blended with 1.5 times the mean slope at the start, or
    // ramped
    ASSERT_LE(std::abs(forces_N[tick] - forces_N[tick - 1]), 50 * records[n].dt_s) << tick;
  }
  EXPECT_EQ(version, 20u);
}

// ---- causes of late ticks, with a device whose ticks come every 4 ms instead of the declared 2 ms

constexpr auto kLate = 4ms;

// causes page faults for the given time
void fault_for(std::chrono::nanoseconds time) {
  constexpr std::size_t kPages = 16;
  static const auto page = static_cast<std::size_t>(::sysconf(_SC_PAGESIZE));
  for (const auto end = std::chrono::steady_clock::now() + time; std::chrono::steady_clock::now() < end;) {
    void* room = ::mmap(nullptr, kPages * page, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    for (std::size_t n = 0; n < kPages; ++n) static_cast<volatile char*>(room)[n * page] = 1;
    ::munmap(room, kPages * page);
    std::this_thread::sleep_for(200us);
  }
}

// ticks on a vendor's threads, one after another, while the loop's own thread waits
struct CalledBack {
  using Wait = std::function<void()>;
  /// @param between  executed by the vendor's threads between two ticks, one entry per thread
  /// @param waiting  executed by the loop's own thread meanwhile
  CalledBack(std::vector<Wait> between, Wait waiting)
      : between_(std::move(between)), waiting_(std::move(waiting)) {
    driver.info.drive = DeviceInfo::Drive::kCallback;
    driver.info.rate_hz = 500;
  }
  TestDriver driver{[this](TestDriver& self, ServoFunction& servo, ServoClock& clock) {
    for (std::size_t n = 0; n < between_.size(); ++n) {
      std::atomic<bool> ended{false};
      // the next thread reuses this one's stack and therefore its address
      std::thread vendor([&, n] {
        while (!clock.stopped() && thread == n) {
          between_[n]();
          self.tick_at(servo, Point<Device>(kBoneRadius_mm, 0, 0));
        }
        ended = true;
      });
      while (!ended) waiting_();
      vendor.join();
    }
  }};
  std::atomic<std::size_t> thread{0};  // thread that ticks; all earlier ones have ended

 private:
  std::vector<Wait> between_;
  Wait waiting_;
};

const auto sleeps_late = [] { std::this_thread::sleep_for(kLate); };
const auto faults = [] { fault_for(kLate); };

TEST(Loop, LateCallbackTicksAreAttributedToTheVendorThread) {
  CalledBack faulting({faults}, sleeps_late);
  const auto loop = started(faulting.driver, {.realtime = false});
  // some ticks may be late by steal time of this machine
  wait_until([&] { return loop->health().late.page_fault > 20; });
  loop->stop();
}

TEST(Loop, EventsOfTheWaitingThreadAreNotLateCauses) {
  CalledBack late({sleeps_late}, faults);
  const auto loop = started(late.driver, {.realtime = false});
  // the first ticks of a thread fault on memory that it accesses for the first time
  wait_until([&] { return loop->health().late.total() > 20; });
  loop->reset_health();
  wait_until([&] { return loop->health().late.total() > 60; });
  loop->stop();
  const LateCounts counts = loop->health().late;
  EXPECT_LT(counts.page_fault, counts.total() / 4);
}

TEST(Loop, CausesFollowAChangeOfTheDriverThread) {
  CalledBack changing({sleeps_late, faults, sleeps_late}, sleeps_late);
  const auto loop = started(changing.driver, {.realtime = false});
  wait_until([&] { return loop->health().late.total() > 20; });
  loop->reset_health();
  changing.thread = 1;
  wait_until([&] { return loop->health().late.page_fault > 20; });
  changing.thread = 2;
  const std::uint64_t ticks = loop->health().ticks;
  wait_until([&] { return loop->health().ticks > ticks + 20; });
  loop->reset_health();
  wait_until([&] { return loop->health().late.total() > 40; });
  loop->stop();
  const LateCounts counts = loop->health().late;
  EXPECT_LT(counts.page_fault, counts.total() / 4);
}

// ---- on a clock controlled by the test: two runs are identical tick by tick

std::atomic<std::int64_t> test_time_ns{0};
std::int64_t test_clock() noexcept {
  return test_time_ns.load();
}

// hash of a whole run of ticks; `meanwhile` may interfere
std::uint64_t run_hash(const std::function<void(Loop&)>& meanwhile, double ring_s, std::uint64_t* dropped) {
  constexpr int kTicks = 3000;
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {.rate_hz = 1000, .ring_s = ring_s}, test_clock);
  std::atomic<bool> done{false};
  std::thread other([&] {
    while (!done) meanwhile(loop);
  });
  std::uint64_t hash = 0;
  for (int n = 0; n < kTicks; ++n) {
    test_time_ns += 1'000'000;
    DeviceSample sample;
    const double angle = 1e-3 * n;
    sample.tip = Point<Device>(kBoneRadius_mm * std::cos(angle), kBoneRadius_mm * std::sin(angle), 0);
    sample.taken_ns = test_time_ns;
    DeviceCommand command;
    loop.update({&sample, 1}, {&command, 1});
    hash = hash * 31 + loop.snapshot().state_hash;
  }
  done = true;
  other.join();
  *dropped = loop.health().dropped;
  return hash;
}

TEST(Loop, ReadersDoNotChangeTicks) {
  std::uint64_t dropped = 0;
  std::vector<TickRecord> used(64);
  const auto alone = run_hash([](Loop&) { std::this_thread::sleep_for(1ms); }, 4, &dropped);
  EXPECT_EQ(dropped, 0u);

  // a recorder that keeps up, and one that never reads
  EXPECT_EQ(alone, run_hash([&](Loop& loop) { loop.ring().pop(used); }, 4, &dropped));
  EXPECT_EQ(dropped, 0u);
  EXPECT_EQ(alone, run_hash([](Loop&) { std::this_thread::sleep_for(1ms); }, 0.1, &dropped));
  EXPECT_EQ(dropped, 3000u - 128) << "all but what the ring holds";

  // a viewer that reads continuously; base/snapshot_test.cc covers one that is killed while reading
  EXPECT_EQ(alone, run_hash([](Loop& loop) { static_cast<void>(loop.snapshot()); }, 4, &dropped));
}

// one tick, a period or more after the last, at a position
DeviceCommand tick_after(Loop& loop, std::int64_t passed_ns, double x_mm = kBoneRadius_mm) {
  test_time_ns += passed_ns;
  DeviceSample sample;
  sample.tip = Point<Device>(x_mm, 0, 0);
  sample.taken_ns = test_time_ns;
  DeviceCommand command;
  loop.update({&sample, 1}, {&command, 1});
  return command;
}

TEST(Loop, StallWithSuspendedWatchdogZeroesTheForceThenRampsIn) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {}, test_clock);
  for (int n = 0; n < 700; ++n) tick_after(loop, 1'000'000);
  const double full_N = loop.snapshot().device[0].force_N[0];
  ASSERT_GT(full_N, 1);
  // without a watchdog the loop itself measures the elapsed time
  EXPECT_EQ(tick_after(loop, kStall_ns + 1).force_N, Vector<Device>());
  EXPECT_TRUE(loop.snapshot().device[0].flags & kFlagHalted);
  EXPECT_LT(tick_after(loop, 1'000'000).force_N.norm(), 0.01 * full_N);
}

// a clock that has a number of ticks, as a host without threads gives them
class FewTicks final : public ServoClock {
 public:
  explicit FewTicks(int left) : left_(left) {}
  bool wait() noexcept override {
    if (left_ == 0) return false;
    --left_;
    test_time_ns += 1'000'000;
    return true;
  }
  bool stopped() const noexcept override { return false; }

 private:
  int left_;
};

TEST(Loop, UnthreadedLoopTicksOnTheCaller) {
  test_time_ns = 1'000'000;
  std::vector<double> forces_N;
  TestDriver driver([&](TestDriver&, ServoFunction& servo, ServoClock& clock) {
    while (clock.wait()) {
      DeviceSample sample;
      sample.tip = Point<Device>(kBoneRadius_mm, 0, 0);
      sample.taken_ns = test_time_ns;
      DeviceCommand command;
      servo.update({&sample, 1}, {&command, 1});
      forces_N.push_back(command.force_N.norm());
    }
  });
  auto made = ServoLoop::make_unthreaded(ball(), driver, {}, {WorkspaceSettings{}}, {}, test_clock);
  ASSERT_TRUE(made.ok()) << made.error().message();
  ServoLoop& loop = **made;
  for (int portion = 0; portion < 175; ++portion) {
    FewTicks four(4);
    loop.run(four);
  }
  // the same ticks of a loop that is called tick by tick
  test_time_ns = 1'000'000;
  TestDriver idle([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop other(ball(), idle, {}, {WorkspaceSettings{}}, {}, test_clock);
  ASSERT_EQ(forces_N.size(), 700U);
  for (const double force_N : forces_N) EXPECT_EQ(tick_after(other, 1'000'000).force_N.norm(), force_N);
  EXPECT_GT(forces_N.back(), 1);
  EXPECT_EQ(loop.snapshot().tick, other.snapshot().tick);
  loop.emergency_stop();
  FewTicks one(1);
  loop.run(one);
  EXPECT_EQ(forces_N.back(), 0);
}

TEST(Loop, UnthreadedLoopRejectsInvalidArguments) {
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  EXPECT_FALSE(ServoLoop::make_unthreaded(nullptr, driver, {}, {WorkspaceSettings{}}, {}, test_clock).ok());
  EXPECT_FALSE(
      ServoLoop::make_unthreaded(ball(), driver, {}, {WorkspaceSettings{}}, {.rate_hz = 1}, test_clock).ok());
}

TEST(Loop, EmergencyStopCanBeSetAsAParameter) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {}, test_clock);
  for (int n = 0; n < 700; ++n) tick_after(loop, 1'000'000);
  loop.change([](Parameters& parameters) { parameters.emergency_stop = true; });
  EXPECT_EQ(tick_after(loop, 1'000'000).force_N, Vector<Device>());
  std::uint32_t number = 0;
  EXPECT_EQ(loop.rearm(0, number), RearmResult::kNotStopped);
  EXPECT_EQ(tick_after(loop, 1'000'000).force_N, Vector<Device>()) << "the parameter still requests the stop";
}

TEST(Loop, EmergencyStopWinsWithinATick) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {}, test_clock);
  std::uint32_t number = 0;
  // contact is unknown before the first tick
  EXPECT_EQ(loop.rearm(loop.emergency_stop(), number), RearmResult::kNotApplied);
  constexpr double kFree_mm = kBoneRadius_mm + 8;
  for (int n = 0; n < 10; ++n) tick_after(loop, 1'000'000, kFree_mm);
  // rearmed and stopped again before a tick has read either
  EXPECT_EQ(loop.rearm(loop.arming().number, number), RearmResult::kDone);
  const std::uint32_t last = loop.emergency_stop();
  tick_after(loop, 1'000'000, kFree_mm);
  EXPECT_TRUE(loop.snapshot().switches & kSwitchEmergencyStop);
  EXPECT_EQ(loop.snapshot().arming_number, last);
  // a stop after an armed tick
  EXPECT_EQ(loop.rearm(last, number), RearmResult::kDone);
  tick_after(loop, 1'000'000, kFree_mm);
  EXPECT_FALSE(loop.snapshot().switches & kSwitchEmergencyStop);
  EXPECT_EQ(loop.snapshot().arming_number, number);
  loop.emergency_stop();
  tick_after(loop, 1'000'000, kFree_mm);
  EXPECT_TRUE(loop.snapshot().switches & kSwitchEmergencyStop);
}

TEST(Loop, LatenessIsMeasuredByTheDeviceClock) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  driver.info.drive = DeviceInfo::Drive::kExchange;
  driver.info.rate_hz = 500;
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {.rate_hz = 1000}, test_clock);
  for (int n = 0; n < 100; ++n) tick_after(loop, 2'000'000);
  EXPECT_EQ(loop.health().on_time, 1);
  EXPECT_EQ(loop.health().lateness.max_us, 0);
  tick_after(loop, 3'500'000);
  EXPECT_LT(loop.health().on_time, 1);
  EXPECT_NEAR(loop.health().lateness.max_us, 1500, 1);
}

TEST(Loop, OnTimeFractionNeverExceedsOne) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {.rate_hz = 1000}, test_clock);
  std::atomic<bool> observed{false};
  std::atomic<int> ticks{0};
  std::thread ticking([&] {
    while (!observed) {
      tick_after(loop, 1'000'000);
      ++ticks;
    }
  });
  double largest = 0;
  // repeated until both threads have overlapped: on a busy machine one of them may not run for long
  for (int n = 0; n < 2000 || ticks < 2000; ++n) {
    if (n % 500 == 499) loop.reset_health();
    largest = std::max(largest, loop.health().on_time);
  }
  observed = true;
  ticking.join();
  EXPECT_LE(largest, 1);
}

TEST(Loop, StiffnessIsBoundedByTheVendorLimit) {
  // a millimetre deep in the ball of 1.5 N/mm; the caller states what a hand can hold
  bool simulated = true;
  const auto rendered_N = [&simulated](std::optional<double> vouched, double limit_N_per_mm) {
    test_time_ns = 1'000'000;
    TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
    driver.info.simulated = simulated;
    driver.info.stiffness_N_per_mm = vouched;
    Parameters parameters;
    parameters.method = ForceMethod::kProxy;
    parameters.viscosity = parameters.friction = false;
    parameters.device[0].max_stiffness_N_per_mm = limit_N_per_mm;
    auto model = std::make_shared<const Model>(testing::with_exact_surfaces(*ball()));
    Loop loop(std::move(model), driver, parameters, {WorkspaceSettings{}}, {}, test_clock);
    for (int n = 0; n < 200; ++n) tick_after(loop, 1'000'000, kBoneRadius_mm + 1 - 0.01 * n);
    for (int n = 0; n < 600; ++n) tick_after(loop, 1'000'000, kBoneRadius_mm - 1);
    const DeviceTick device = loop.snapshot().device[0];
    EXPECT_EQ(device.max_stiffness_N_per_mm, loop.parameters().device[0].max_stiffness_N_per_mm);
    return std::pair{device.max_stiffness_N_per_mm, device.force_N[0]};
  };
  constexpr double kNone = std::numeric_limits<double>::infinity();
  const auto expect = [&](std::optional<double> vouched, double held, double largest, double force_N) {
    SCOPED_TRACE(vouched.value_or(-7));
    const auto [rendered, pushed_N] = rendered_N(vouched, held);
    EXPECT_EQ(rendered, largest);
    EXPECT_NEAR(pushed_N, force_N, 0.03);
  };
  expect({}, kNone, kNone, 1.5);
  expect(0.6, kNone, 0.6, 0.6);
  expect(0.6, 0.9, 0.6, 0.6);
  expect(0.6, 0.4, 0.4, 0.4);
  expect(5.0, kNone, 5.0, 1.5);
  // an invalid stiffness renders nothing
  expect(-1.0, kNone, 0, 0);
  expect(std::nan(""), kNone, 0, 0);

  // a physical device always has a bound, whatever its vendor and the caller omit
  simulated = false;
  const double careful = conservative_bounds(DeviceInfo()).stiffness_N_per_mm;
  for (const double held : {kNone, std::nan("")})
    for (const std::optional<double> declared : {std::optional<double>(), std::optional<double>(kNone)})
      expect(declared, held, careful, careful);
  expect({}, 0.1, 0.1, 0.1);
  expect(0.6, kNone, 0.6, 0.6);
  expect(std::nan(""), kNone, 0, 0);
}

TEST(Loop, PhysicalDeviceBoundCannotBeChanged) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  driver.info.simulated = false;
  Parameters parameters;
  parameters.method = ForceMethod::kTrilinear;
  parameters.viscosity = parameters.friction = false;
  parameters.passivity = false;
  Loop loop(ball(), driver, parameters, {WorkspaceSettings{}}, {}, test_clock);
  loop.change([](Parameters& edited) {
    edited.device[0].max_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
    edited.device[0].max_damping_N_s_per_mm = kNoValue;
  });
  ASSERT_TRUE(loop.set_model(ball(2, 4)).ok());
  for (int n = 0; n < 700; ++n) tick_after(loop, 1'000'000);
  const DeviceTick device = loop.snapshot().device[0];
  const ConservativeBounds careful = conservative_bounds(driver.info);
  EXPECT_EQ(device.max_stiffness_N_per_mm, careful.stiffness_N_per_mm);
  EXPECT_EQ(device.max_damping_N_s_per_mm, careful.damping_N_s_per_mm);
  // a direct method's field of 4 N over 2 mm is scaled down to the bound
  EXPECT_GT(device.force_N[0], 0);
  EXPECT_LT(device.force_N[0], 8 * careful.stiffness_N_per_mm);
}

TEST(Loop, SceneForceLimitOverridesParameters) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  Loop loop(ball(), driver, {}, {WorkspaceSettings{}}, {}, test_clock);
  for (int n = 0; n < 700; ++n) tick_after(loop, 1'000'000);
  ASSERT_GT(loop.snapshot().device[0].force_N[0], 1);
  Model strict = *ball(2);
  strict.scene_max_force_N = 0.5;
  ASSERT_TRUE(loop.set_model(std::make_shared<const Model>(std::move(strict))).ok());
  EXPECT_LE(tick_after(loop, 1'000'000).force_N.norm(), 0.5);
  EXPECT_EQ(loop.snapshot().device[0].limit_N, 0.5);
}

// independent of the workspace and of the object's rotation
TEST(Loop, PatientFrameTipMovesWithTheObject) {
  test_time_ns = 1'000'000;
  TestDriver driver([](TestDriver&, ServoFunction&, ServoClock&) {});
  driver.info.in_patient = true;
  WorkspaceSettings far;
  far.scale = 3;
  far.yaw_deg = 30;
  far.home = Point<World>(70, 0, 0);
  Loop loop(ball(), driver, {}, {far}, {}, test_clock);
  const auto off_mm = [&] {
    tick_after(loop, 1'000'000);
    const auto tip = loop.snapshot().device[0].tip_patient_mm;
    return std::hypot(tip[0] - kBoneRadius_mm, tip[1], tip[2]);
  };
  EXPECT_LT(off_mm(), 1e-9);
  loop.change([](Parameters& parameters) {
    parameters.rotation_target = Eigen::AngleAxisd(0.5, Eigen::Vector3d(1, 2, 3).normalized());
  });
  double max_mm = 0;
  for (int n = 0; n < 3000; ++n) max_mm = std::max(max_mm, off_mm());
  EXPECT_LT(max_mm, 0.1) << "a tick behind while it turns";
  EXPECT_LT(off_mm(), 1e-9);
  EXPECT_LT(std::abs(loop.snapshot().rotation_applied_wxyz[0] - std::cos(0.25)), 1e-6) << "it has turned";
}

TEST(Loop, RejectsInvalidArguments) {
  Resting resting;
  const auto refused = [&](const LoopSettings& settings) {
    const auto loop = ServoLoop::start(ball(), resting.driver, {}, {WorkspaceSettings{}}, settings);
    EXPECT_FALSE(loop.ok());
    return loop.ok() ? "" : loop.error().message();
  };
  EXPECT_NE(refused({.rate_hz = 20}).find("250 to 10000"), std::string::npos);
  EXPECT_NE(refused({.rate_hz = std::nan("")}), "");
  EXPECT_NE(refused({.spin_s = -1}), "");
  EXPECT_NE(refused({.ring_s = 0}), "");
  const auto refused_with = [&](std::shared_ptr<const Model> model,
                                const std::vector<WorkspaceSettings>& workspaces) {
    const auto loop = ServoLoop::start(std::move(model), resting.driver, {}, workspaces, {});
    return !loop.ok() && loop.error().kind == ErrorKind::kUsage;
  };
  EXPECT_TRUE(refused_with(nullptr, {WorkspaceSettings{}}));
  EXPECT_TRUE(refused_with(std::make_shared<const Model>(), {WorkspaceSettings{}}));
  EXPECT_TRUE(refused_with(ball(), {}));
  EXPECT_TRUE(refused_with(ball(), std::vector<WorkspaceSettings>(2)));
  std::array<WorkspaceSettings, 4> wrong;
  wrong[0].scale = 0;
  wrong[1].force_gain = std::nan("");
  wrong[2].yaw_deg = std::nan("");
  wrong[3].home = Point<World>(std::nan(""), 0, 0);
  for (const WorkspaceSettings& workspace : wrong) EXPECT_TRUE(refused_with(ball(), {workspace}));
  resting.driver.info.moves_by_itself = true;
  EXPECT_NE(refused({}).find("move"), std::string::npos);
  EXPECT_NE(started(resting.driver, {.may_move = true}), nullptr);
}

TEST(Loop, ReportsThreadCreationFailure) {
  Resting resting;
  const test::NoThreads none;
  const auto loop = ServoLoop::start(ball(), resting.driver, {}, {WorkspaceSettings{}}, {.realtime = false});
  ASSERT_FALSE(loop.ok());
  EXPECT_EQ(loop.error().kind, ErrorKind::kUnavailable);
  EXPECT_NE(loop.error().what.find("cannot start the servo thread"), std::string::npos)
      << loop.error().message();
}

}  // namespace
}  // namespace palpate
