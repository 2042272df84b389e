#include "server/distance_message.h"

#include <algorithm>

#include "palpate/base/check.h"
#include "server/pose_message.h"
#include "server/wire_writer.h"

namespace palpate::server {
namespace {

constexpr std::size_t kTickAt = 8, kAfterTick = 16;

void write_near(WireWriter& out, const DeviceTick& device) {
  out.unsigned_integer(device.no_go);
  out.unsigned_integer(std::uint16_t{0});
  out.real32(device.no_go_depth_mm);
  out.real32(device.no_go_N);
  for (std::size_t n = 0; n < device.near_label.size(); ++n) {
    out.unsigned_integer(device.near_label[n]);
    out.unsigned_integer(std::uint16_t{0});
    out.real32(device.near_mm[n]);
  }
}

}  // namespace

DistanceMessage::DistanceMessage(const TickRecord& tick) {
  const int devices = std::clamp(tick.devices, 1, kMaxDevices);
  size_ = kHead_bytes + static_cast<std::size_t>(devices) * kDevice_bytes;
  WireWriter out(bytes_.data());
  for (const char c : std::string_view("PLPN")) out.unsigned_integer(static_cast<std::uint8_t>(c));
  out.unsigned_integer(static_cast<std::uint16_t>(kProtocolVersion));
  out.unsigned_integer(static_cast<std::uint16_t>(size_));
  PALPATE_CHECK(out.at() == bytes_.data() + kTickAt);
  out.unsigned_integer(tick.tick);
  PALPATE_CHECK(out.at() == bytes_.data() + kAfterTick);
  out.unsigned_integer(static_cast<std::uint16_t>(devices));
  out.unsigned_integer(std::uint16_t{0});
  out.unsigned_integer(std::uint32_t{0});
  PALPATE_CHECK(out.at() == bytes_.data() + kHead_bytes);
  for (int d = 0; d < devices; ++d) write_near(out, tick.device[static_cast<std::size_t>(d)]);
  PALPATE_CHECK(out.at() == bytes_.data() + size_);
}

bool DistanceMessage::equals_except_tick(const DistanceMessage& other) const {
  return size_ == other.size_ &&
         std::equal(bytes_.begin() + kAfterTick, bytes_.begin() + static_cast<std::ptrdiff_t>(size_),
                    other.bytes_.begin() + kAfterTick);
}

}  // namespace palpate::server
