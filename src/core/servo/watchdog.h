#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "palpate/base/heartbeat.h"
#include "palpate/device/device.h"

namespace palpate {

/// Time without a completed tick after which the watchdog halts the devices, ns.
inline constexpr std::int64_t kStall_ns = 9'000'000;

/// Watches the servo thread from a thread of its own. It halts the devices if no tick has ended for
/// kStall_ns, or if a supervisor has halted them, and resumes them once ticks continue. Ticks in between read
/// halted() and send nothing, so that the output stage ramps the force in afterwards.
class Watchdog {
 public:
  /// @param heartbeat  memory shared with the supervisor; nullptr: none
  Watchdog(DeviceDriver& driver, Heartbeat* heartbeat) : driver_(driver), heartbeat_(heartbeat) {}
  ~Watchdog() { end(); }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  /// Starts the watchdog's thread and returns the scheduler that it was granted. Throws std::system_error if
  /// no thread could be created.
  /// @param realtime   request a priority above the servo's
  /// @param servo_cpu  CPU that the servo is bound to, which the watchdog keeps off; -1: none
  std::string begin(bool realtime, int servo_cpu);
  /// Ends stall detection: the devices are at rest, and their driver may take any time to shut down.
  void stand_down() noexcept {
    standing_down_.store(true);
    if (heartbeat_ != nullptr) heartbeat_->beat_ns.store(Heartbeat::kResting);
  }
  /// Stops the watchdog; call after the servo thread has ended. Resumes a driver that the watchdog has
  /// halted, for the next loop; a supervisor's halt stays in force.
  void end();

  // ---- the servo thread
  /// Records that a tick has ended.
  void beat(std::int64_t now_ns) noexcept {
    beats_.store(beats_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    beat_ns_.store(now_ns, std::memory_order_release);
    if (heartbeat_ != nullptr && !standing_down_.load(std::memory_order_relaxed))
      heartbeat_->beat_ns.store(now_ns, std::memory_order_release);
  }
  /// Records that no further tick is due.
  void disarm() noexcept {
    beat_ns_.store(kResting, std::memory_order_release);
    if (heartbeat_ != nullptr) heartbeat_->beat_ns.store(Heartbeat::kResting);
  }

  // ---- any thread
  bool halted() const noexcept { return halted_.load(std::memory_order_acquire); }
  std::uint64_t stalls() const noexcept { return stalls_.load(); }

 private:
  static constexpr std::int64_t kResting = Heartbeat::kResting;
  void guard();
  void check(std::int64_t now_ns);

  DeviceDriver& driver_;
  Heartbeat* const heartbeat_;
  std::atomic<bool> end_{false}, halted_{false}, standing_down_{false};
  std::atomic<std::int64_t> beat_ns_{kResting};
  std::atomic<std::uint64_t> beats_{0}, stalls_{0};
  std::uint64_t beats_when_halted_ = 0;  // owned by the watchdog's thread
  std::thread thread_;
};

}  // namespace palpate
