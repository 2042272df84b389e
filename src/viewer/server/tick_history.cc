#include "palpate/server/tick_history.h"

#include <algorithm>

#include "server/wire_writer.h"

namespace palpate {
namespace {

template <std::size_t kCount>
std::array<float, kCount> reals32(const std::array<double, kCount>& values) {
  std::array<float, kCount> out;
  std::ranges::transform(values, out.begin(), server::wire_float);
  return out;
}

}  // namespace

BundledTick::BundledTick(const TickRecord& record)
    : tick(record.tick),
      time_s(record.time_s),
      model_version(record.model_version),
      devices(static_cast<std::uint32_t>(std::clamp(record.devices, 1, kMaxDevices))),
      rotation_wxyz(reals32(record.rotation_applied_wxyz)) {
  for (std::size_t d = 0; d < devices; ++d) {
    const DeviceTick& from = record.device[d];
    device[d] = {reals32(from.tip_patient_mm),
                 reals32(from.proxy_patient_mm),
                 reals32(from.orientation_wxyz),
                 reals32(from.force_N),
                 server::wire_float(from.unclamped_force_N),
                 server::wire_float(from.depth_mm),
                 from.flags,
                 from.buttons,
                 from.label};
  }
}

void TickHistory::add(const TickRecord& record) {
  const BundledTick tick(record);
  const std::lock_guard lock(mutex_);
  ticks_[count_ % kCapacity] = tick;
  ++count_;
}

std::uint64_t TickHistory::count() const {
  const std::lock_guard lock(mutex_);
  return count_;
}

std::size_t TickHistory::copy(std::uint64_t& first, std::span<BundledTick> out) const {
  const std::lock_guard lock(mutex_);
  if (count_ > kCapacity) first = std::max(first, count_ - kCapacity);
  first = std::min(first, count_);
  const std::size_t copied = std::min<std::uint64_t>(out.size(), count_ - first);
  for (std::size_t n = 0; n < copied; ++n) out[n] = ticks_[(first + n) % kCapacity];
  return copied;
}

}  // namespace palpate
