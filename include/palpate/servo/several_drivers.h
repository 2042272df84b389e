#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "palpate/device/device.h"
#include "palpate/servo/servo_loop.h"

namespace palpate {

struct SeveralSettings {
  double rate_hz = 1000;  ///< kLowestRate_hz ... kHighestRate_hz; of followers without a clock of their own
  bool realtime = true;   ///< ask for SCHED_FIFO for the followers' threads
  int servo_cpu = -1;     ///< the CPU that the servo is bound to, which they keep off; -1: none
};

/// Several drivers as one: the devices of all of them in one tick. One driver owns the clock; each of the
/// others runs in a thread of its own, at its own rate, and follows.
///
///     owner      |tick |tick |tick |tick |tick |tick |tick |tick |tick        in the owner's thread
///                   ▲     ▲     ▲     ▲  the newest state that each follower has told
///     follower   |update     |update     |update     |update                  in its own
///                ▲ the newest command that a tick has left for it
///
/// Neither waits for the other: states and commands go by mailboxes. What a follower's update answers was
/// computed by a tick from the state of the update before, so its force comes a period of its own and one of
/// the owner's later than alone: devices() says so (delay_s), and holds a physical one to careful_bounds()
/// for that, whatever its maker vouches for in a loop without. A command older than kOldCommand_s is none.
///
/// The owner is the driver whose devices push a hand: physical before simulated, and of those the fastest;
/// simulated ones that nobody feels (a pointer) last. Devices keep the order of the drivers.
class SeveralDrivers final : public DeviceDriver {
 public:
  /// @param drivers  at least one, of at most kMaxDevices devices together, which this process holds
  ///                 (halt_file() < 0); outlive this
  SeveralDrivers(std::vector<DeviceDriver*> drivers, const SeveralSettings& settings);
  ~SeveralDrivers() override;

  std::span<const DeviceInfo> devices() const override;
  std::size_t clock_owner() const override;
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  /// Of the first device that has any; where a follower's driver has given up, that.
  std::optional<Error> trouble() const override;

  /// The threads of followers, in the order of their drivers; of ones that have not run, nothing but the
  /// name.
  std::vector<TickingThread> followers() const;

  static constexpr double kOldCommand_s = 0.01;

 private:
  class Follower;
  class Gatherer;
  struct Part {
    DeviceDriver* driver;
    std::size_t first = 0, count = 0;  // of its devices
  };
  void arrange();
  void make_followers();

  const std::vector<DeviceDriver*> drivers_;
  const SeveralSettings settings_;
  std::vector<Part> parts_;
  std::vector<DeviceInfo> infos_;
  std::size_t owner_ = 0;     // of parts_
  mutable std::mutex mutex_;  // of the list below, which run() makes anew
  std::vector<std::unique_ptr<Follower>> followers_;
};

}  // namespace palpate
