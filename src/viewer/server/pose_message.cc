#include "server/pose_message.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "palpate/base/check.h"
#include "server/wire_writer.h"

namespace palpate::server {
namespace {

constexpr std::size_t kSequenceAt = 8;

std::uint32_t counted(std::uint64_t count) {
  return static_cast<std::uint32_t>(
      std::min<std::uint64_t>(count, std::numeric_limits<std::uint32_t>::max()));
}

std::uint16_t cutting_mN(double cutting_N) {
  constexpr double kMost = std::numeric_limits<std::uint16_t>::max();
  return static_cast<std::uint16_t>(std::lround(std::clamp(1e3 * cutting_N, 0.0, kMost)));
}

double norm(const std::array<double, 3>& v) {
  return std::hypot(v[0], v[1], v[2]);
}

void write_device(WireWriter& out, const DeviceTick& device, double stiffness_N_per_mm) {
  out.reals32(device.tip_patient_mm);
  out.reals32(device.proxy_patient_mm);
  out.reals32(device.normal_patient);
  out.reals32(device.orientation_wxyz);
  out.reals32(device.force_N);
  out.real32(device.unclamped_force_N);
  out.real32(device.limit_N);
  out.real32(device.heat);
  out.real32(device.depth_mm);
  out.real32(norm(device.velocity_patient_mm_s));
  out.real32(stiffness_N_per_mm);
  out.unsigned_integer(device.flags);
  out.unsigned_integer(device.buttons);
  out.unsigned_integer(device.label);
  out.unsigned_integer(cutting_mN(device.cutting_N));
  out.real32(device.cutting_energy_mJ_per_mm3);
  for (std::size_t n = 0; n < device.path_label.size(); ++n) {
    out.unsigned_integer(device.path_label[n]);
    out.unsigned_integer(std::uint16_t{0});
    out.real32(device.path_depth_mm[n]);
    out.real32(device.path_share[n]);
  }
  for (std::size_t n = 0; n < device.contact_label.size(); ++n) {
    out.unsigned_integer(device.contact_label[n]);
    out.unsigned_integer(device.contact_part[n]);
    for (std::size_t axis = 0; axis < 3; ++axis) out.real32(device.contact_patient_mm[3 * n + axis]);
    out.real32(device.contact_N[n]);
  }
}

}  // namespace

PoseMessage::PoseMessage(const TickRecord& tick, const std::array<double, kMaxDevices>& stiffness_N_per_mm,
                         const ViewedHealth& health, std::int64_t clock_ns) {
  const int devices = std::clamp(tick.devices, 1, kMaxDevices);
  size_ = kHead_bytes + static_cast<std::size_t>(devices) * kDevice_bytes;
  WireWriter out(bytes_.data());
  for (const char c : std::string_view("PLPT")) out.unsigned_integer(static_cast<std::uint8_t>(c));
  out.unsigned_integer(static_cast<std::uint16_t>(kProtocolVersion));
  out.unsigned_integer(static_cast<std::uint16_t>(size_));
  // sequence number, set by set_sequence()
  out.unsigned_integer(std::uint64_t{0});
  out.unsigned_integer(tick.tick);
  out.real64(tick.time_s);
  out.unsigned_integer(static_cast<std::uint64_t>(clock_ns));
  out.unsigned_integer(tick.model_version);
  out.unsigned_integer(tick.method);
  out.unsigned_integer(tick.switches);
  out.unsigned_integer(static_cast<std::uint8_t>(devices));
  out.unsigned_integer(std::uint8_t{0});
  out.reals32(tick.rotation_applied_wxyz);
  out.real32(health.rate_hz);
  out.real32(health.lateness_p50_us);
  out.real32(health.lateness_p99_us);
  out.real32(health.lateness_max_us);
  out.real32(health.compute_p50_us);
  out.unsigned_integer(counted(health.skipped));
  out.unsigned_integer(counted(health.dropped));
  out.unsigned_integer(counted(health.stalls));
  PALPATE_CHECK(out.at() == bytes_.data() + kHead_bytes);
  for (int d = 0; d < devices; ++d) write_device(out, tick.device[d], stiffness_N_per_mm[d]);
  PALPATE_CHECK(out.at() == bytes_.data() + size_);
}

void PoseMessage::set_sequence(std::uint64_t sequence) {
  WireWriter(bytes_.data() + kSequenceAt).unsigned_integer(sequence);
}

}  // namespace palpate::server
