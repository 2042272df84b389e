#pragma once

#include <atomic>
#include <cstdint>
#include <string>
#include <thread>

#include "palpate/base/heartbeat.h"
#include "palpate/device/device.h"

namespace palpate {

inline constexpr std::int64_t kStall_ns = 9'000'000;

/// Watches the servo thread from another one: halts the devices when no tick has ended for kStall_ns, or when
/// a supervisor has halted them, and lets them go on when ticks come again. The ticks until then see halted()
/// and send nothing, so that the output stage brings the force in anew.
class Watchdog {
 public:
  /// @param heartbeat  what a supervisor is told; nullptr: there is none
  Watchdog(DeviceDriver& driver, Heartbeat* heartbeat) : driver_(driver), heartbeat_(heartbeat) {}
  ~Watchdog() { end(); }
  Watchdog(const Watchdog&) = delete;
  Watchdog& operator=(const Watchdog&) = delete;

  /// Returns what scheduling its thread got. Throws std::system_error when there is no thread to be had.
  /// @param realtime   ask for a priority above the servo's
  /// @param servo_cpu  the CPU that the servo is bound to, -1: none; the watchdog keeps off it
  std::string begin(bool realtime, int servo_cpu);
  /// Nothing is a stall from here on: the devices are at rest, and their driver may take its time.
  void stand_down() noexcept {
    standing_down_.store(true);
    if (heartbeat_ != nullptr) heartbeat_->beat_ns.store(Heartbeat::kResting);
  }
  /// After the servo thread has ended. A driver that this one has halted is let go, for the next loop; a
  /// supervisor's halt stays.
  void end();

  // ---- the servo thread
  /// A tick has ended.
  void beat(std::int64_t now_ns) noexcept {
    beats_.store(beats_.load(std::memory_order_relaxed) + 1, std::memory_order_relaxed);
    beat_ns_.store(now_ns, std::memory_order_release);
    if (heartbeat_ != nullptr && !standing_down_.load(std::memory_order_relaxed))
      heartbeat_->beat_ns.store(now_ns, std::memory_order_release);
  }
  /// No tick is due any more.
  void rest() noexcept {
    beat_ns_.store(kResting, std::memory_order_release);
    if (heartbeat_ != nullptr) heartbeat_->beat_ns.store(Heartbeat::kResting);
  }

  // ---- any thread
  bool halted() const noexcept { return halted_.load(std::memory_order_acquire); }
  std::uint64_t stalls() const noexcept { return stalls_.load(); }

 private:
  static constexpr std::int64_t kResting = Heartbeat::kResting;
  void guard();
  void look(std::int64_t now_ns);

  DeviceDriver& driver_;
  Heartbeat* const heartbeat_;
  std::atomic<bool> end_{false}, halted_{false}, standing_down_{false};
  std::atomic<std::int64_t> beat_ns_{kResting};
  std::atomic<std::uint64_t> beats_{0}, stalls_{0};
  std::uint64_t beats_when_halted_ = 0;  // the guard's
  std::thread thread_;
};

}  // namespace palpate
