#pragma once

#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <stdexcept>

#include "palpate/base/clock.h"
#include "palpate/base/heartbeat.h"
#include "palpate/device/device.h"
#include "palpate/servo/realtime.h"

/// Device held by another process, for tests: the part behind a driver's port that survives the process of
/// the driver. It has no watchdog: it continues its last command.
namespace palpate::testing {

/// Indirect throw, for noexcept functions, where the compiler would warn.
inline void throw_for_a_test() {
  throw std::runtime_error("thrown for a test");
}

/// Memory shared by driver and device, readable by the test.
struct TestDeviceMemory {
  // ---- written by the driver
  std::atomic<double> force_N{0};
  std::atomic<std::uint64_t> commands{0};
  std::atomic<bool> halted{false};
  std::atomic<std::uint64_t> ended_halts{0};
  // ---- written by the device: every transition between acting and resting
  struct Change {
    std::atomic<std::int64_t> at_ns{0};
    std::atomic<bool> acts{false};
  };
  static constexpr std::size_t kMaxChanges = 4096;
  std::array<Change, kMaxChanges> changes;
  std::atomic<std::uint32_t> change_count{0};
  std::atomic<double> acting_N{0};

  /// Time since which no force acts; 0: a force acts.
  std::int64_t at_rest_since() const {
    const std::uint32_t n = change_count.load();
    return n == 0 || changes[n - 1].acts ? 0 : changes[n - 1].at_ns.load();
  }
};

/// Driver with a constant tip inside the tissue.
class TestDeviceDriver final : public DeviceDriver {
 public:
  TestDeviceDriver(TestDeviceMemory& memory, int halt_fd, const Point<Device>& tip)
      : memory_(memory), halt_fd_(halt_fd), tip_(tip) {
    info_.name = "test device";
    info_.peak_force_N = 3;
    // stiffer than any tissue here, so that no conservative bound reduces the stiffness
    info_.stiffness_N_per_mm = 10;
  }
  std::span<const DeviceInfo> devices() const override { return {&info_, 1}; }
  Result<void> open(bool /*may_move*/) override { return {}; }
  void run(ServoFunction& servo, ServoClock& clock) noexcept override {
    DeviceSample sample;
    sample.tip = tip_;
    DeviceCommand command;
    // unblocks the signal used for freezing, which the loop's other threads block
    sigset_t freezing;
    ::sigemptyset(&freezing);
    ::sigaddset(&freezing, kFreeze);
    ::pthread_sigmask(SIG_UNBLOCK, &freezing, nullptr);
    ticking_ = ::pthread_self();
    while (clock.wait()) {
      while (hangs) ::usleep(100);
      if (throws) throw_for_a_test();
      sample.taken_ns = monotonic_ns();
      servo.update({&sample, 1}, {&command, 1});
      memory_.force_N = command.force_N.norm();
      memory_.commands.fetch_add(1);
    }
    memory_.force_N = 0;
  }
  void halt() noexcept override {
    if (throws_in_halt) throw_for_a_test();
    memory_.halted = true;
  }
  void resume(std::uint64_t newest) noexcept override {
    memory_.ended_halts = std::max(memory_.ended_halts.load(), newest);
    memory_.halted = false;
  }
  int halt_fd() const noexcept override { return halt_fd_; }

  /// Suspends the ticking thread at an arbitrary instruction until `frozen` is false.
  void freeze() {
    frozen = true;
    ::signal(kFreeze, [](int) {
      while (frozen) {
        constexpr timespec kPause{0, 100'000};
        ::nanosleep(&kPause, nullptr);
      }
    });
    ::pthread_kill(ticking_, kFreeze);
  }

  std::atomic<bool> hangs{false};           ///< Ticks cease
  std::atomic<bool> throws{false};          ///< Throws in the next tick, on the servo's thread
  std::atomic<bool> throws_in_halt{false};  ///< Throws on the thread that halts it, the watchdog's
  static inline std::atomic<bool> frozen{false};

 private:
  // not a signal by which a test ends processes
  static inline const int kFreeze = SIGRTMIN + 1;
  TestDeviceMemory& memory_;
  const int halt_fd_;
  const Point<Device> tip_;
  DeviceInfo info_;
  std::atomic<pthread_t> ticking_{};
};

/// Protocol of a device's halt pipe. The order in which halts and ends arrive does not matter.
class HaltFile {
 public:
  explicit HaltFile(int file) : file_{file, POLLIN, 0} {}

  /// Reads everything available; if there is nothing, waits up to `wait`.
  void read(timespec wait) {
    // a closed pipe is always readable: do not wait again, and do not spin
    while (::ppoll(&file_, newest_ == Heartbeat::kPermanentHalt ? 0 : 1, &wait, nullptr) > 0) {
      std::array<std::uint64_t, 64> halts{};
      const ssize_t received = ::read(file_.fd, halts.data(), sizeof halts);
      // no writer is left, or the writer does not follow the protocol
      const bool whole = received > 0 && static_cast<std::size_t>(received) % sizeof halts[0] == 0;
      newest_ = whole ? std::max(newest_, std::ranges::max(halts)) : Heartbeat::kPermanentHalt;
      wait = {};
    }
  }
  /// @param ended  newest halt that has ended
  bool halts(std::uint64_t ended) const { return newest_ > ended; }

 private:
  pollfd file_;
  std::uint64_t newest_ = 0;
};

/// Main loop of the device, at 4 kHz, until it is killed.
/// @param halted  read end of the driver's halt pipe
[[noreturn]] inline void be_test_device(TestDeviceMemory& memory, int halted) {
  // scheduled like a device's own electronics
  make_this_thread_realtime({.fifo = true,
                             .priority = 97,
                             .lock_memory = false,
                             .cpu = -1,
                             .priorities_above = 0,
                             .name = "test-device"});
  HaltFile file(halted);
  bool acted = false;
  for (;;) {
    file.read({0, 250'000});
    const bool halts = memory.halted || file.halts(memory.ended_halts);
    const double acting_N = halts ? 0.0 : memory.force_N.load();
    memory.acting_N = acting_N;
    const bool acts = acting_N > 0;
    if (acts == acted) continue;
    acted = acts;
    const std::uint32_t n = memory.change_count.load();
    if (n == TestDeviceMemory::kMaxChanges) continue;
    memory.changes[n].at_ns = monotonic_ns();
    memory.changes[n].acts = acts;
    memory.change_count = n + 1;
  }
}

}  // namespace palpate::testing
