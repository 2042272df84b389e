#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "palpate/device/telemetry.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

inline constexpr int kProtocol = 3;

/// One pose as viewers get it, in the layout of docs/reference/viewer-messages.md.
class PoseMessage {
 public:
  static constexpr std::size_t kHead_bytes = 96, kDevice_bytes = 296;

  PoseMessage() = default;
  /// @param stiffness_N_per_mm  of the touched tissue of each device
  /// @param clock_ns            when the snapshot was taken, CLOCK_MONOTONIC
  PoseMessage(const TickRecord& tick, const std::array<double, kMaxDevices>& stiffness_N_per_mm,
              const ViewedHealth& health, std::int64_t clock_ns);

  /// The number that tells a viewer what it missed.
  void set_sequence(std::uint64_t sequence);
  std::string_view bytes() const { return {bytes_.data(), size_}; }

 private:
  std::array<char, kHead_bytes + kMaxDevices * kDevice_bytes> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace palpate::link
