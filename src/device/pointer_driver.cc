#include "palpate/device/pointer_driver.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/clock.h"
#include "palpate/base/mailbox.h"

namespace palpate {
namespace {

constexpr std::int64_t kHeld_ns = static_cast<std::int64_t>(PointerDriver::kHeld_s * 1e9);
// a page that redraws 250 times a second, and one that rests and says so 30 times
constexpr std::int64_t kLeastInterval_ns = 4'000'000, kMostInterval_ns = 40'000'000;

}  // namespace

PointerDriver::PointerDriver(const Point<Device>& tip, TimeSource now)
    : now_(now ? now : monotonic_ns),
      info_(info()),
      messages_(std::make_unique<Mailbox<Message>>()),
      from_(tip),
      to_(tip) {}

PointerDriver::~PointerDriver() = default;

DeviceInfo PointerDriver::info() {
  DeviceInfo info;
  info.name = "pointer";
  info.simulated = true;
  info.degrees_of_freedom_out = 0;
  return info;
}

void PointerDriver::move(const Point<Device>& tip) noexcept {
  PALPATE_CHECK(tip.all_finite());
  messages_->post({tip, now_(), true});
}

void PointerDriver::release() noexcept {
  messages_->post({});
}

Result<void> PointerDriver::open(bool /*may_move*/) {
  return {};
}

Point<Device> PointerDriver::tip_at(std::int64_t now_ns) const {
  if (now_ns >= to_ns_) return to_;
  return from_ +
         (to_ - from_) * (static_cast<double>(now_ns - from_ns_) / static_cast<double>(to_ns_ - from_ns_));
}

// The next way begins where the tip is, and takes as long as the next message is likely to. Nobody knows of
// one who comes back how he got there: then there is no way, lest a contact is dragged along it.
void PointerDriver::take_message(std::int64_t now_ns) {
  Message message;
  if (!messages_->take(message)) return;
  const bool comes_back = message.held && !(last_.held && message.at_ns - last_.at_ns <= kHeld_ns);
  from_ = comes_back ? message.tip : tip_at(now_ns);
  from_ns_ = now_ns;
  to_ = message.held ? message.tip : from_;
  const std::int64_t interval_ns =
      std::clamp(message.at_ns - last_.at_ns, kLeastInterval_ns, kMostInterval_ns);
  const double way_ns = (to_ - from_).norm() / kMostSpeed_mm_s * 1e9;
  to_ns_ = now_ns + std::max(interval_ns, static_cast<std::int64_t>(std::min(way_ns, 1e18)));
  last_ = message;
}

void PointerDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  std::array<DeviceSample, 1> samples;
  std::array<DeviceCommand, 1> commands{};
  while (clock.wait()) {
    const std::int64_t now_ns = now_();
    take_message(now_ns);
    samples[0].tip = tip_at(now_ns);
    samples[0].taken_ns = last_.held ? std::min(now_ns, last_.at_ns + kHeld_ns) : 0;
    servo.update(samples, commands);
  }
}

}  // namespace palpate
