#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdint>
#include <vector>

#include "palpate/supervisor/supervisor.h"

namespace palpate {

/// The memory that session and supervisor share.
struct SharedBlock {
  static constexpr std::uint64_t kMagic = 0x70616c7061746531;  // another program's memory is not taken for it
  static constexpr std::uint32_t kMostEvents = 64;

  const std::uint64_t magic = kMagic;
  Heartbeat heartbeat;
  std::atomic<bool> ended{false};     // by the session: it is over, and its devices are at rest
  std::atomic<bool> watching{false};  // by the supervisor: it is ready

  // by the supervisor: its scheduling, before `watching`; its events, each before the count that has it
  std::array<char, 160> scheduler{};
  std::array<SupervisorEvent, kMostEvents> events{};
  std::atomic<std::uint32_t> event_count{0};

  void add(const SupervisorEvent& event) noexcept {
    const std::uint32_t count = event_count.load(std::memory_order_relaxed);
    events[count % kMostEvents] = event;
    event_count.store(count + 1, std::memory_order_release);
  }
  /// Exact once nothing is added any more; of one that is just added the oldest may be half replaced.
  std::vector<SupervisorEvent> all() const {
    const std::uint32_t count = event_count.load(std::memory_order_acquire);
    std::vector<SupervisorEvent> found;
    for (std::uint32_t n = count > kMostEvents ? count - kMostEvents : 0; n < count; ++n)
      found.push_back(events[n % kMostEvents]);
    return found;
  }
};

// the files of the supervisor's process, by number
inline constexpr int kBlockFile = 3, kSessionFile = 4, kFirstHaltFile = 5;
inline constexpr std::size_t kMostHaltFiles = 8;

}  // namespace palpate
