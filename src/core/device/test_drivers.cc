#include "device/test_drivers.h"

#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>

#include "palpate/base/clock.h"

namespace palpate::testing {
namespace {

void sleep_ns(std::int64_t duration_ns) {
  std::this_thread::sleep_for(std::chrono::nanoseconds(duration_ns));
}

}  // namespace

bool TestClock::wait() noexcept {
  sleep_ns(period_ns_);
  return !stopped_;
}

void DeliveryLog::add(const Delivery& delivery) {
  const std::lock_guard lock(mutex_);
  all_.push_back(delivery);
}

std::vector<Delivery> DeliveryLog::all() const {
  const std::lock_guard lock(mutex_);
  return all_;
}

RealTimePlant::RealTimePlant(const SimulatedDevice& device) : device_(device), last_ns_(monotonic_ns()) {}

DeviceSample RealTimePlant::advance(const DeviceCommand& acting) {
  const std::int64_t now_ns = monotonic_ns();
  // limits the catch-up after a long stall, which would otherwise delay every later update further
  const double passed_s =
      std::min(static_cast<double>(now_ns - last_ns_) * 1e-9, SimulatedDriver::kMaxAdvance_s);
  if (passed_s > 0) device_.advance(acting, passed_s);
  last_ns_ = now_ns;
  DeviceSample sample = device_.read();
  sample.taken_ns = now_ns;
  return sample;
}

// ---- callback ----

void FakeVendor::schedule(std::function<bool()> callback) {
  PALPATE_CHECK(!scheduler_.joinable());
  scheduled_ = true;
  scheduler_ = std::thread([this, callback = std::move(callback)] {
    scheduler_id_ = std::this_thread::get_id();
    while (scheduled_ && callback()) sleep_ns(kPeriod_ns);
    if (in_frame_) ++violations_;
    scheduled_ = false;
  });
}

void FakeVendor::unschedule() {
  scheduled_ = false;
  if (scheduler_.joinable()) scheduler_.join();
}

bool FakeVendor::may_call(bool in_frame) {
  const bool may = scheduler_id_.load() == std::this_thread::get_id() && in_frame_ == in_frame;
  if (!may) ++violations_;
  return may;
}

void FakeVendor::begin_frame() {
  if (!may_call(false)) return;
  in_frame_ = true;
  set_ = {};
  sample_ = plant_.advance(enabled_ ? acting_ : DeviceCommand{});
}

DeviceSample FakeVendor::state() {
  return may_call(true) ? sample_ : DeviceSample{};
}

void FakeVendor::set_force(const DeviceCommand& command) {
  if (may_call(true)) set_ = command;
}

void FakeVendor::end_frame() {
  if (!may_call(true)) return;
  in_frame_ = false;
  // time first: whatever is recorded after the switch changed must reflect the switch
  const std::int64_t at_ns = monotonic_ns();
  (void)plant_.advance(enabled_ ? acting_ : DeviceCommand{});
  acting_ = enabled_ ? set_ : DeviceCommand{};
  delivered_.add({at_ns, acting_, sample_, false});
}

CallbackDriver::CallbackDriver(FakeVendor& vendor, bool moves_by_itself)
    : vendor_(vendor), info_(vendor.info()) {
  info_.drive = DeviceInfo::Drive::kCallback;
  info_.moves_by_itself = moves_by_itself;
}

void CallbackDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  vendor_.schedule([&] {
    vendor_.begin_frame();
    const std::array<DeviceSample, 1> samples{vendor_.state()};
    std::array<DeviceCommand, 1> commands{};
    const bool last = clock.stopped();
    if (!last) servo.update(samples, commands);
    vendor_.set_force(halted_ ? DeviceCommand{} : commands[0]);
    vendor_.end_frame();
    return !last;
  });
  while (vendor_.scheduled()) sleep_ns(FakeVendor::kPeriod_ns);
  vendor_.unschedule();
}

// the flag stops later frames, the switch the current one, which may hang
void CallbackDriver::halt() noexcept {
  halted_ = true;
  vendor_.enable_force(false);
}

void CallbackDriver::resume(std::uint64_t /*newest*/) noexcept {
  halted_ = false;
  vendor_.enable_force(true);
}

// ---- exchange ----

FakePeer::FakePeer(const SimulatedDevice& device) : plant_(device) {
  std::array<int, 2> ends{};
  PALPATE_CHECK(::socketpair(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0, ends.data()) == 0);
  near_ = ends[0];
  far_ = ends[1];
  thread_ = std::thread([this] { serve(); });
}

FakePeer::~FakePeer() {
  ended_ = true;
  thread_.join();
  ::close(near_);
  ::close(far_);
}

void FakePeer::serve() {
  DeviceCommand acting;
  std::int64_t last_ns = monotonic_ns();
  bool idle = true;
  while (!ended_) {
    pollfd readable{far_, POLLIN, 0};
    Request request;
    if (::poll(&readable, 1, 1) == 1 && ::recv(far_, &request, sizeof request, 0) == sizeof request) {
      const DeviceSample sample = plant_.advance(acting);
      last_ns = sample.taken_ns;
      idle = false;
      acting.force_N = Vector<Device>(request.force_N);
      delivered_.add({monotonic_ns(), acting, sample, false});
      const Reply reply{request.number, sample.tip.eigen()};
      if (!silent_) (void)::send(far_, &reply, sizeof reply, MSG_DONTWAIT);
    } else if (!idle && monotonic_ns() - last_ns > kIdle_ns) {
      const DeviceSample sample = plant_.advance(acting);
      idle = true;
      acting = {};
      delivered_.add({monotonic_ns(), acting, sample, true});
    }
  }
}

ExchangeDriver::ExchangeDriver(FakePeer& peer) : peer_(peer), info_(peer.info()) {
  info_.drive = DeviceInfo::Drive::kExchange;
}

// one round trip; without a reply in time the sample stays unchanged
void ExchangeDriver::exchange(const DeviceCommand& command, DeviceSample& sample) noexcept {
  const FakePeer::Request request{++number_, command.force_N.eigen()};
  const std::int64_t sent_ns = monotonic_ns();
  if (::send(peer_.socket(), &request, sizeof request, MSG_DONTWAIT) != sizeof request) {
    sleep_ns(kTimeout_ms * 1'000'000);
    return;
  }
  pollfd readable{peer_.socket(), POLLIN, 0};
  while (::poll(&readable, 1, kTimeout_ms) == 1) {
    FakePeer::Reply reply;
    if (::recv(peer_.socket(), &reply, sizeof reply, 0) != sizeof reply) return;
    // a late reply to an earlier request is outdated
    if (reply.number != request.number) continue;
    sample.tip = Point<Device>(reply.tip_mm);
    sample.taken_ns = sent_ns;
    return;
  }
}

void ExchangeDriver::run(ServoFunction& servo, ServoClock& clock) noexcept {
  std::array<DeviceSample, 1> samples;
  std::array<DeviceCommand, 1> commands{};
  while (!clock.stopped()) {
    exchange(halted_ ? DeviceCommand{} : commands[0], samples[0]);
    // no state exists before the first reply
    if (samples[0].taken_ns != 0) servo.update(samples, commands);
  }
  exchange({}, samples[0]);
}

}  // namespace palpate::testing
