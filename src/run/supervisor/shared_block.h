#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "palpate/supervisor/supervisor.h"

namespace palpate {

/// Memory shared by session and supervisor.
struct SharedBlock {
  static constexpr std::uint64_t kMagic = 0x70616c7061746531;  // identifies the memory as a SharedBlock
  static constexpr std::uint32_t kMaxEvents = 64;

  const std::uint64_t magic = kMagic;
  Heartbeat heartbeat;
  std::atomic<bool> ended{false};     // set by the session: it is over, and its devices are at rest
  std::atomic<bool> watching{false};  // set by the supervisor: it is ready

  // written by the supervisor: scheduling, before `watching`; events, each before the count that includes it
  std::array<char, 160> scheduler{};
  std::array<SupervisorEvent, kMaxEvents> events{};
  std::atomic<std::uint32_t> event_count{0};

  void add(const SupervisorEvent& event) noexcept {
    const std::uint32_t count = event_count.load(std::memory_order_relaxed);
    events[count % kMaxEvents] = event;
    event_count.store(count + 1, std::memory_order_release);
  }
  /// Exact once no more events are added; during add() the oldest event may be partly overwritten.
  std::vector<SupervisorEvent> all() const {
    const std::uint32_t count = event_count.load(std::memory_order_acquire);
    std::vector<SupervisorEvent> found;
    for (std::uint32_t n = count > kMaxEvents ? count - kMaxEvents : 0; n < count; ++n)
      found.push_back(events[n % kMaxEvents]);
    return found;
  }
};

// file descriptors in the supervisor's process
inline constexpr int kBlockFile = 3, kSessionFile = 4, kFirstHaltFile = 5;
inline constexpr std::size_t kMaxHaltFiles = 8;

}  // namespace palpate
