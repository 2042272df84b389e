#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "palpate/device/telemetry.h"
#include "palpate/server/viewer_host.h"

namespace palpate::server {

inline constexpr int kProtocolVersion = 3;

/// Binary message with the pose and the forces of one tick, in the layout of
/// docs/reference/viewer-messages.md.
class PoseMessage {
 public:
  static constexpr std::size_t kHead_bytes = 96, kDevice_bytes = 296;

  PoseMessage() = default;
  /// @param stiffness_N_per_mm  rendered stiffness of the tissue in contact, per device
  /// @param clock_ns            time of the snapshot, CLOCK_MONOTONIC
  PoseMessage(const TickRecord& tick, const std::array<double, kMaxDevices>& stiffness_N_per_mm,
              const ViewedHealth& health, std::int64_t clock_ns);

  /// Sets the sequence number, from which a viewer counts missed messages.
  void set_sequence(std::uint64_t sequence);
  std::string_view bytes() const { return {bytes_.data(), size_}; }

 private:
  std::array<char, kHead_bytes + kMaxDevices * kDevice_bytes> bytes_{};
  std::size_t size_ = 0;
};

}  // namespace palpate::server
