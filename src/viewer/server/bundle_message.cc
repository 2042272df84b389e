#include "server/bundle_message.h"

#include <algorithm>
#include <array>

#include "palpate/base/check.h"
#include "server/pose_message.h"
#include "server/wire_writer.h"

namespace palpate::server {
namespace {

class FieldWriter {
 public:
  explicit FieldWriter(WireWriter& out) : out_(out) {}

  void operator()(const char*, std::uint32_t value, const char*) { out_.unsigned_integer(value); }
  void operator()(const char*, std::uint64_t value, const char*) { out_.unsigned_integer(value); }
  void operator()(const char*, double value, const char*) { out_.real64(value); }
  void operator()(const char*, float value, const char*) { out_.real32(value); }
  template <std::size_t kCount>
  void operator()(const char*, const std::array<float, kCount>& values, const char*) {
    for (const float value : values) out_.real32(value);
  }

 private:
  WireWriter& out_;
};

}  // namespace

void BundleLimit::on_sent(std::chrono::nanoseconds duration) {
  constexpr auto kMaxDuration = std::chrono::milliseconds(250);
  constexpr std::size_t kMinTicks = 16;
  ticks_ = duration > kMaxDuration ? std::max(ticks_ / 2, kMinTicks) : std::min(2 * ticks_, kMaxBundledTicks);
}

bool next_bundle(const TickHistory& history, SentTicks& sent, std::span<BundledTick> scratch,
                 std::string& bytes) {
  std::uint64_t first = sent.next;
  const std::span<const BundledTick> ticks = scratch.first(history.copy(first, scratch));
  if (ticks.empty()) return false;
  sent.next = first + ticks.size();
  for (const BundledTick& tick : ticks) {
    if (sent.sequence != 0 || &tick != ticks.data()) sent.lost += tick.tick - sent.last - 1;
    sent.last = tick.tick;
  }
  ++sent.sequence;

  std::size_t size = kBundleHead_bytes;
  for (const BundledTick& tick : ticks) size += kBundledTick_bytes + tick.devices * kBundledDevice_bytes;
  bytes.resize(size);
  WireWriter out(bytes.data());
  for (const char c : std::string_view("PLPB")) out.unsigned_integer(static_cast<std::uint8_t>(c));
  out.unsigned_integer(static_cast<std::uint16_t>(kProtocolVersion));
  out.unsigned_integer(std::uint16_t{0});
  out.unsigned_integer(static_cast<std::uint32_t>(size));
  out.unsigned_integer(static_cast<std::uint32_t>(ticks.size()));
  out.unsigned_integer(sent.sequence);
  out.unsigned_integer(sent.lost);
  PALPATE_CHECK(out.at() == bytes.data() + kBundleHead_bytes);
  FieldWriter write(out);
  for (const BundledTick& tick : ticks) {
    visit_wire_fields(tick, write);
    for (std::size_t d = 0; d < tick.devices; ++d) visit_wire_fields(tick.device[d], write);
  }
  PALPATE_CHECK(out.at() == bytes.data() + size);
  return true;
}

}  // namespace palpate::server
