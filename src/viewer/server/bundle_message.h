#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "palpate/server/tick_history.h"

namespace palpate::server {

/// Maximum number of ticks in a bundle.
inline constexpr std::size_t kMaxBundledTicks = 1024;

/// Layout of the binary message with consecutive ticks (docs/reference/viewer-messages.md).
inline constexpr std::size_t kBundleHead_bytes = 32, kBundledTick_bytes = 40, kBundledDevice_bytes = 72;

/// Ticks that one viewer has received in bundles.
struct SentTicks {
  std::uint64_t next = 0;      ///< Index in the history of the first tick of its next bundle
  std::uint64_t sequence = 0;  ///< Number of its bundles
  std::uint64_t last = 0;      ///< TickRecord::tick of the last tick sent, if sequence is not 0
  std::uint64_t lost = 0;      ///< Ticks between its first and its last one that it did not receive
};

/// Maximum length of a viewer's next bundle. Over a slow connection bundles become short, so that poses
/// between them are recent, and no single message takes as long as the time after which a viewer that
/// receives nothing is disconnected.
class BundleLimit {
 public:
  std::size_t ticks() const { return ticks_; }
  /// Adapts the limit.
  /// @param duration  from the begin of a bundle's write to its end
  void on_sent(std::chrono::nanoseconds duration);

 private:
  std::size_t ticks_ = 128;
};

/// Writes the next bundle for a viewer, and marks its ticks as sent. Returns whether there are any.
/// @param scratch  at least one tick; limits the bundle's length
/// @param bytes    receives the message; its memory is used again
bool next_bundle(const TickHistory& history, SentTicks& sent, std::span<BundledTick> scratch,
                 std::string& bytes);

}  // namespace palpate::server
