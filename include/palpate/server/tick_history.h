#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <mutex>
#include <span>
#include <vector>

#include "palpate/device/telemetry.h"

/// The latest ticks of a session, for viewers that receive every tick (docs/reference/viewer-messages.md).
///
///    servo ── ring ──► recorder's thread ── add() ──► TickHistory ── copy() ──► server's thread ──► viewers
///
/// Neither the servo nor the recorder waits for a viewer: the oldest ticks are overwritten, and a viewer that
/// reads too slowly receives the number of ticks it has missed.
namespace palpate {

/// State of one device in a tick, in the precision in which viewers receive it.
struct BundledDevice {
  std::array<float, 3> tip_patient_mm{}, proxy_patient_mm{};
  std::array<float, 4> orientation_wxyz{};
  std::array<float, 3> force_N{};
  float unclamped_force_N = 0, depth_mm = 0;
  std::uint32_t flags = 0, buttons = 0, label = 0;
};
/// One tick, in the precision in which viewers receive it.
struct BundledTick {
  std::uint64_t tick = 0;
  double time_s = 0;
  std::uint32_t model_version = 0, devices = 1;
  std::array<float, 4> rotation_wxyz{};
  std::array<BundledDevice, kMaxDevices> device{};

  BundledTick() = default;
  explicit BundledTick(const TickRecord& record);
};

/// Calls `of(name, value, description)` for every number of a device, in the order of the message. The
/// message, its table in the manual and the page's types are derived from it.
template <class Visit>
void visit_wire_fields(const BundledDevice& device, Visit&& of) {
  const auto& [tip, proxy, orientation, force, unclamped, depth, flags, buttons, label] = device;
  of("tip_patient_mm", tip, "tip, patient, mm");
  of("proxy_patient_mm", proxy, "proxy, patient, mm, as in a pose");
  of("orientation_wxyz", orientation, "tool's orientation in World");
  of("force_N", force, "force sent, World, N");
  of("unclamped_force_N", unclamped, "magnitude of the force before the output stage, N");
  of("depth_mm", depth, "depth, mm; NaN if no surface is within reach");
  of("flags", flags, "flags (`palpate::TickFlag`)");
  of("buttons", buttons, "buttons");
  of("label", label, "touched structure's label, 0 none");
}
/// The same for the numbers of a tick, without its devices.
template <class Visit>
void visit_wire_fields(const BundledTick& tick, Visit&& of) {
  of("tick", tick.tick, "tick");
  of("time_s", tick.time_s, "session time at the tick's begin, s");
  of("model_version", tick.model_version, "model version");
  of("devices", tick.devices, "devices that follow, 1 to 4");
  of("rotation_wxyz", tick.rotation_wxyz, "rotation of the object about World's origin");
}

/// Bounded history of ticks from one writer for any number of readers.
class TickHistory {
 public:
  /// Ticks that are stored: 8 s at 1 kHz, 2.5 MiB.
  static constexpr std::size_t kCapacity = 8192;

  TickHistory() : ticks_(kCapacity) {}

  /// Appends a tick. One thread only, and not the servo's: it takes a lock.
  void add(const TickRecord& record);
  /// Number of ticks added so far, which is the index of the next one.
  std::uint64_t count() const;
  /// Copies ticks from index `first` on, in order, and returns their number. Ticks that are overwritten, or
  /// not added yet, are left out.
  /// @param first  in: index of the first tick wanted; out: index of the first one copied
  std::size_t copy(std::uint64_t& first, std::span<BundledTick> out) const;

 private:
  mutable std::mutex mutex_;        // guards the members below
  std::vector<BundledTick> ticks_;  // tick of index n is at n % kCapacity
  std::uint64_t count_ = 0;
};

}  // namespace palpate
