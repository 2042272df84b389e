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

/// Options of CompositeDriver.
struct CompositeDriverSettings {
  /// Update rate of followers without a clock of their own, kMinRate_hz ... kMaxRate_hz
  double rate_hz = 1000;
  bool realtime = true;  ///< Request SCHED_FIFO for the followers' threads
  int servo_cpu = -1;    ///< CPU that the servo is bound to, which followers keep off; -1: none
};

/// Combines several drivers so that one tick has the devices of all of them. One driver owns the clock; each
/// of the others (a follower) runs in a thread of its own, at its own rate.
///
///     owner      |tick |tick |tick |tick |tick |tick |tick |tick |tick        in the owner's thread
///                   ▲     ▲     ▲     ▲  newest state published by each follower
///     follower   |update     |update     |update     |update                  in its own
///                ▲ newest command published by a tick
///
/// Neither side waits for the other: states and commands are exchanged by mailboxes. A follower's update
/// returns the force that a tick computed from the state of the update before. Its force is therefore later
/// than without the combination by one of its own periods and one of the owner's. devices() includes this in
/// delay_s and, because of it, limits a physical follower to conservative_bounds() even if its vendor vouches
/// for more. Commands older than kOldCommand_s are ignored.
///
/// The owner is a driver whose devices exert force: physical drivers take precedence over simulated ones, and
/// faster ones over slower ones. Simulated devices without force (a pointer) are chosen last. Devices keep
/// the order of the drivers.
class CompositeDriver final : public DeviceDriver {
 public:
  /// @param drivers  at least one, with at most kMaxDevices devices in total, all held by this process
  ///                 (halt_fd() < 0); must outlive this object
  CompositeDriver(std::vector<DeviceDriver*> drivers, const CompositeDriverSettings& settings);
  ~CompositeDriver() override;

  std::span<const DeviceInfo> devices() const override;
  std::size_t clock_owner() const override;
  Result<void> open(bool may_move) override;
  void run(ServoFunction& servo, ServoClock& clock) noexcept override;
  void halt() noexcept override;
  void resume(std::uint64_t newest) noexcept override;
  /// Failure of the first device that reports one; also reports a follower whose driver has terminated.
  std::optional<Error> failure() const override;

  /// The followers' threads, in the order of their drivers; for one that has not run yet, only the name.
  std::vector<TickingThread> followers() const;

  static constexpr double kOldCommand_s = 0.01;

 private:
  class Follower;
  class Gatherer;
  struct Part {
    DeviceDriver* driver;
    std::size_t first = 0, count = 0;  // range of its devices
  };
  void arrange();
  void make_followers();

  const std::vector<DeviceDriver*> drivers_;
  const CompositeDriverSettings settings_;
  std::vector<Part> parts_;
  std::vector<DeviceInfo> infos_;
  std::size_t owner_ = 0;     // index into parts_
  mutable std::mutex mutex_;  // guards followers_, which run() recreates
  std::vector<std::unique_ptr<Follower>> followers_;
};

}  // namespace palpate
