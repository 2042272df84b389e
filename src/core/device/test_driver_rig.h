#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "base/test_seed.h"
#include "base/test_wait.h"
#include "device/test_wall.h"

/// Tests of vendors' drivers, each against a stand-in for the vendor's side.
namespace palpate::testing {

/// Runs a driver in a thread of its own, with its first device pressing against a wall. A derived class has
/// the vendor's side as an earlier base, so that it outlives the driver.
template <class Driver>
class DriverRig {
 public:
  /// @param force_N  returns the force that acts on the first device now
  DriverRig(std::unique_ptr<Driver> made, std::function<double()> force_N)
      : driver(std::move(made)), force_N_(std::move(force_N)) {}
  ~DriverRig() { end(); }

  void open_and_begin() {
    const auto opened = driver->open(false);
    EXPECT_TRUE(opened.ok()) << (opened.ok() ? "" : opened.error().message());
    if (opened) begin();
  }
  void begin() {
    clock.stop = false;
    thread_ = std::thread([this] { driver->run(wall, clock); });
  }
  void end() {
    clock.stop = true;
    if (thread_.joinable()) thread_.join();
  }
  bool presses() {
    return thread_.joinable() && soon([&] {
             return std::abs(wall.tip_x_mm - kWallPressed_mm) < 0.02 && force_N_() > 0.5 && !wall.fault;
           });
  }
  bool releases() {
    return soon([&] { return force_N_() == 0; });
  }
  bool says(const char* words) {
    return soon([&] {
      const auto failure = driver->failure();
      return failure && failure->what.find(words) != std::string::npos && !failure->remedy.empty();
    });
  }
  std::string declared() const {
    const auto failure = driver->failure();
    return failure ? failure->what : "nothing";
  }

  std::unique_ptr<Driver> driver;
  GuardedWall wall;
  UntilStopped clock;

 private:
  const std::function<double()> force_N_;
  std::thread thread_;
};

/// A fault at the vendor's side that can be injected and removed.
template <class Side>
struct DriverFault {
  const char* name;
  std::function<void(Side&)> begin, end;
  const char* words;   ///< Part of the message that the driver reports then
  bool alone = false;  ///< Excludes others that are `alone`
};

template <class Side>
DriverFault<Side> flag_fault(const char* name, std::atomic<bool> Side::*member, bool faulty,
                             const char* words) {
  return {name, [=](Side& side) { side.*member = faulty; }, [=](Side& side) { side.*member = !faulty; },
          words};
}

/// Faults that are active at present.
template <class Side>
class StartedFaults {
 public:
  StartedFaults(Side& side, const std::vector<DriverFault<Side>>& known) : side_(side), known_(known) {}
  /// Injects one to four faults at intervals of at most 30 ms.
  void begin_any(std::mt19937& random, const std::function<void()>& meanwhile) {
    for (unsigned step = 1 + random() % 4; step > 0; --step) {
      const DriverFault<Side>& fault = known_[random() % known_.size()];
      if (fault.alone && std::ranges::any_of(there_, [](const auto* each) { return each->alone; })) continue;
      fault.begin(side_);
      there_.push_back(&fault);
      std::this_thread::sleep_for(std::chrono::milliseconds(random() % 30));
      meanwhile();
    }
  }
  /// Removes all faults in random order.
  void end_all(std::mt19937& random) {
    while (!there_.empty()) {
      const std::size_t next = random() % there_.size();
      there_[next]->end(side_);
      there_.erase(there_.begin() + static_cast<std::ptrdiff_t>(next));
    }
  }
  std::string names() const {
    std::string all;
    for (const auto* fault : there_) all += std::string(" ") + fault->name;
    return all;
  }

 private:
  Side& side_;
  const std::vector<DriverFault<Side>>& known_;
  std::vector<const DriverFault<Side>*> there_;
};

/// Number of fault sequences; PALPATE_TEST_FAULTS overrides the default.
inline int fault_sequences(int by_default) {
  const char* value = std::getenv("PALPATE_TEST_FAULTS");
  return value ? std::atoi(value) : by_default;
}

/// Random faults, in sequence and combined, with halts in between: no force while one is active, and full
/// force after all are removed.
template <class Driver, class Side>
void outlive_any(DriverRig<Driver>& rig, Side& side, const std::vector<DriverFault<Side>>& faults,
                 int by_default, const std::function<void(std::mt19937&)>& meanwhile = {}) {
  const unsigned seed = test::test_seed();
  SCOPED_TRACE("seed " + std::to_string(seed));
  std::mt19937 random(seed);
  for (int n = 0; n < fault_sequences(by_default); ++n) {
    SCOPED_TRACE("sequence " + std::to_string(n));
    ASSERT_TRUE(rig.presses()) << rig.declared();
    StartedFaults<Side> there(side, faults);
    there.begin_any(random, [&] {
      if (meanwhile) meanwhile(random);
      if (random() % 4 == 0) rig.driver->halt();
    });
    ASSERT_TRUE(rig.releases()) << there.names();
    there.end_all(random);
    rig.driver->resume(0);
  }
  ASSERT_TRUE(rig.presses()) << rig.declared();
  rig.end();
  EXPECT_TRUE(rig.releases());
  EXPECT_FALSE(rig.wall.twice_at_once);
}

}  // namespace palpate::testing
