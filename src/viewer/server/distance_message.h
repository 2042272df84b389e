#pragma once

#include <array>
#include <cstddef>
#include <string_view>

#include "palpate/device/telemetry.h"

namespace palpate::server {

/// Binary message with the structures near the tools and the no-go regions of one tick, in the layout of
/// docs/reference/viewer-messages.md.
class DistanceMessage {
 public:
  static constexpr std::size_t kHead_bytes = 24, kDevice_bytes = 12 + 8 * kMaxNearReported;

  DistanceMessage() = default;
  explicit DistanceMessage(const TickRecord& tick);

  /// Equal apart from the tick number.
  bool equals_except_tick(const DistanceMessage& other) const;
  std::string_view bytes() const { return {bytes_.data(), size_}; }

 private:
  std::array<char, kHead_bytes + kMaxDevices * kDevice_bytes> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace palpate::server
