#include "openhaptics/test_fake_hd.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstring>
#include <deque>
#include <mutex>
#include <new>
#include <optional>
#include <thread>

#include "palpate/base/clock.h"
#include "palpate/device/simulated_device.h"

/// Fake of libHD. It counts violations of the documentation: states read and forces set outside a frame, by
/// another thread than the scheduler's or for a device that is not current; a frame that is not ended; an
/// order other than init, enable, schedule, start and stop, unschedule, disable; an encoder reset while the
/// scheduler runs, any calibration within a frame; a non-finite force.
namespace palpate::testing {
namespace {

constexpr unsigned kBadHandle = 0xFFFFFFFF;
using Callback = unsigned (*)(void*);

FakeHd& fake() {
  static FakeHd one;
  return one;
}

void violated(const char* rule) {
  if (fake().violations.fetch_add(1) == 0) fake().first_violation = rule;
}

struct Behind {
  bool initialised = false, gone = false, in_frame = false;
  std::optional<SimulatedDevice> hand;
  DeviceCommand set, acting;
  DeviceSample sample;
  std::int64_t advanced_ns = 0;
};

// a single lock for the library's state
std::recursive_mutex mutex;
std::array<Behind, 2> behind;
unsigned current = kBadHandle;
struct PushedError {
  unsigned code;
  unsigned handle;
};
std::deque<PushedError> errors;
Callback callback = nullptr;
void* callback_data = nullptr;
std::thread scheduler;
std::atomic<std::thread::id> scheduler_id{};
std::atomic<bool> stop_scheduler{false};

void push(unsigned code, unsigned handle = current) {
  errors.push_back({code, handle});
}
Behind* behind_of(unsigned handle) {
  return handle < behind.size() && behind[handle].initialised ? &behind[handle] : nullptr;
}
FakeHdDevice& device_of(const Behind& known) {
  return fake().device[static_cast<std::size_t>(&known - behind.data())];
}

void resume(Behind& known) {
  FakeHdDevice& device = device_of(known);
  if (!device.plugged) known.gone = true;
  const std::int64_t now_ns = monotonic_ns();
  const DeviceCommand acting = device.force_on && !known.gone ? known.acting : DeviceCommand{};
  device.force_N = acting.force_N.norm();
  known.hand->intend(Point<Device>(device.intended_x_mm, device.intended_y_mm, device.intended_z_mm));
  const double passed_s = std::min(1e-9 * static_cast<double>(now_ns - known.advanced_ns), 0.1);
  if (passed_s > 0) known.hand->advance(acting, passed_s);
  known.advanced_ns = now_ns;
}

void schedule_for_ever() {
  scheduler_id = std::this_thread::get_id();
  while (!stop_scheduler) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
    // motors keep the last commanded force
    {
      const std::lock_guard lock(mutex);
      for (Behind& known : behind)
        if (known.initialised) resume(known);
    }
    if (fake().stalled || stop_scheduler || !callback) continue;
    callback(callback_data);
    const std::lock_guard lock(mutex);
    for (Behind& known : behind) {
      if (known.in_frame) violated("a frame that is not ended");
      known.in_frame = false;
    }
  }
}

// whether states and forces may be accessed
bool may_touch() {
  Behind* known = behind_of(current);
  if (!known) {
    violated("no device is the current one");
    return false;
  }
  if (std::this_thread::get_id() != scheduler_id.load())
    violated("a state or force in a thread not the scheduler's");
  if (!known->in_frame) violated("a state or force outside of a frame");
  return known->in_frame;
}

void reset_all() {
  if (scheduler.joinable()) scheduler.join();
  const std::lock_guard lock(mutex);
  for (Behind& known : behind) known.initialised = false;
  fake().licence = fake().null_name = true;
  fake().stalled = fake().hangs = fake().stop_hangs = false;
  fake().violations = 0;
  fake().first_violation = "";
  errors.clear();
  for (FakeHdDevice& device : fake().device) {
    device.~FakeHdDevice();
    new (&device) FakeHdDevice;
  }
  fake().device[1].config = "Left Device";
  fake().device[1].serial = "4712";
}

struct ErrorInfo {
  unsigned code;
  int internal;
  unsigned handle;
};

}  // namespace
}  // namespace palpate::testing

using namespace palpate::testing;  // NOLINT(google-build-using-namespace): all of it is this one library
using Guard = std::lock_guard<std::recursive_mutex>;

extern "C" {

FakeHd* palpate_fake_hd() {
  fake().reset = reset_all;
  return &fake();
}

unsigned hdInitDevice(const char* name) {
  const Guard lock(mutex);
  if (!fake().licence) {
    push(0x600);
    return kBadHandle;
  }
  for (std::size_t d = 0; d < behind.size(); ++d) {
    FakeHdDevice& device = fake().device[d];
    const bool meant = name ? std::strcmp(name, device.config) == 0 : d == 0 && fake().null_name;
    if (!meant) continue;
    if (behind[d].initialised) {
      violated("initialised twice");
      return kBadHandle;
    }
    if (!device.plugged || !device.communication) break;
    if (fake().running) violated("a device begun while the scheduler runs");
    behind[d].initialised = true;
    behind[d].gone = behind[d].in_frame = false;
    behind[d].hand.emplace(
        palpate::SimulatedDevice({"light", 0.01, 0, 0, 0, 1e9, 1e9}, {"still", 0.01, 12.6, 2000}));
    behind[d].hand->reset(
        palpate::Point<palpate::Device>(device.intended_x_mm, device.intended_y_mm, device.intended_z_mm));
    behind[d].acting = behind[d].set = {};
    behind[d].advanced_ns = palpate::monotonic_ns();
    device.force_on = device.ramping = device.clamping = false;
    ++device.inits;
    current = static_cast<unsigned>(d);
    return current;
  }
  push(0x302, kBadHandle);
  return kBadHandle;
}
void hdDisableDevice(unsigned handle) {
  const Guard lock(mutex);
  Behind* known = behind_of(handle);
  if (!known) return push(0x104, handle);
  if (fake().running) violated("a device disabled while the scheduler runs");
  if (!known->gone && device_of(*known).force_on && known->acting.force_N.norm() > 0)
    violated("a device disabled with a force");
  known->initialised = false;
  device_of(*known).force_N = 0;
  device_of(*known).force_on = false;
  if (current == handle) current = kBadHandle;
}
void hdMakeCurrentDevice(unsigned handle) {
  const Guard lock(mutex);
  if (!behind_of(handle)) return push(0x104, handle);
  current = handle;
}
void hdBeginFrame(unsigned handle) {
  while (fake().hangs) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  const Guard lock(mutex);
  Behind* known = behind_of(handle);
  if (!known) return push(0x104, handle);
  FakeHdDevice& device = device_of(*known);
  if (std::this_thread::get_id() != scheduler_id.load()) violated("a frame in a thread not the scheduler's");
  if (known->in_frame) {
    violated("a frame within a frame of one device");
    return push(0x400, handle);
  }
  known->in_frame = true;
  resume(*known);
  if (!known->gone) known->sample = known->hand->read();
  if (!device.communication) known->gone = true;
  if (known->gone) push(0x302, handle);
  if (const unsigned error = device.error.exchange(0)) push(error, handle);
}
void hdEndFrame(unsigned handle) {
  const Guard lock(mutex);
  Behind* known = behind_of(handle);
  if (!known) return push(0x104, handle);
  if (!known->in_frame) {
    violated("an end without a beginning");
    return push(0x401, handle);
  }
  known->in_frame = false;
  known->acting = known->set;
  resume(*known);
  ++device_of(*known).frames;
}
void hdGetDoublev(unsigned what, double* values) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (what >= 0x2050 && what <= 0x2053) {
    if (!may_touch()) return push(0x402);
    FakeHdDevice& device = device_of(*known);
    if (device.mute) return;
    const palpate::DeviceSample& s = known->sample;
    const double x = device.nowhere ? std::nan("") : s.tip.x();
    const double c = std::cos(device.turned_rad), n = std::sin(device.turned_rad);
    const palpate::Vector<palpate::Device> velocity(known->hand->true_velocity_mm_s() +
                                                    palpate::Vector<palpate::Device>(device.velocity_x_mm_s,
                                                                                     device.velocity_y_mm_s,
                                                                                     device.velocity_z_mm_s));
    switch (what) {
      case 0x2050:
        values[0] = x, values[1] = s.tip.y(), values[2] = s.tip.z();
        return;
      case 0x2051:
        values[0] = velocity.x(), values[1] = velocity.y(), values[2] = velocity.z();
        return;
      case 0x2053:
        values[0] = 0.1, values[1] = 0.2, values[2] = 0.3;
        return;
      default:
        break;
    }
    // column-major; only approximately orthonormal
    const double transform[16] = {1.0001 * c, 0, -n, 0, 0, 1, 0, 0, n, 0, c, 0, x, s.tip.y(), s.tip.z(), 1};
    for (int i = 0; i < 16; ++i) values[i] = device.crooked ? 1 : transform[i];
    return;
  }
  if (!known) return push(0x104);
  FakeHdDevice& device = device_of(*known);
  const double box[6] = {-80, -60, -35, 80, 60, 35};
  switch (what) {
    case 0x2602:
      if (device.stiffness_N_per_mm > 0) *values = device.stiffness_N_per_mm;
      return;
    case 0x2603:
      if (device.max_force_N > 0) *values = device.max_force_N;
      return;
    case 0x2604:
      if (device.continuous_N > 0) *values = device.continuous_N;
      return;
    case 0x2551:
      std::copy(box, box + 6, values);
      return;
    default:
      push(0x100);
  }
}
void hdGetIntegerv(unsigned what, int* values) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return push(0x104);
  switch (what) {
    case 0x2000:
      if (may_touch()) *values = device_of(*known).buttons;
      return;
    case 0x2555:
      *values = device_of(*known).style;
      return;
    case 0x2600:
      *values = device_of(*known).rate_hz;
      return;
    default:
      push(0x100);
  }
}
void hdSetDoublev(unsigned what, const double* values) {
  const Guard lock(mutex);
  if (what != 0x2700) return push(0x100);
  if (!may_touch()) return push(0x402);
  Behind& known = *behind_of(current);
  FakeHdDevice& device = device_of(known);
  const palpate::Vector<palpate::Device> force(values[0], values[1], values[2]);
  if (!std::isfinite(force.norm())) return violated("a force that is no number");
  device.requested_x_N = values[0];
  device.requested_y_N = values[1];
  device.requested_z_N = values[2];
  device.largest_N = std::max(device.largest_N.load(), force.norm());
  known.set.force_N = force;
}
const char* hdGetString(unsigned what) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return nullptr;
  return what == 0x2501   ? device_of(*known).model.load()
         : what == 0x2504 ? device_of(*known).serial.load()
                          : nullptr;
}
void hdEnable(unsigned what) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return push(0x104);
  FakeHdDevice& device = device_of(*known);
  if (what != 0x4000 && device.unguarded) return push(0x100);
  (what == 0x4000 ? device.force_on : what == 0x4001 ? device.clamping : device.ramping) = true;
}
void hdDisable(unsigned what) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return push(0x104);
  FakeHdDevice& device = device_of(*known);
  if (what != 0x4000) return violated("a guard of the library's switched off");
  device.force_on = false;
  device.force_N = 0;
}
ErrorInfo hdGetError() {
  const Guard lock(mutex);
  if (errors.empty()) return {0, 0, kBadHandle};
  const PushedError error = errors.front();
  errors.pop_front();
  return {error.code, 0, error.handle};
}
const char* hdGetErrorString(unsigned code) {
  return code == 0x600 ? "License error" : code == 0x302 ? "Communication error" : "Error";
}
#ifndef PALPATE_FAKE_TOO_OLD
unsigned hdCheckCalibration() {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return 0x5000;
  FakeHdDevice& device = device_of(*known);
  if (device.calibrated && !device.never_calibrates) return 0x5000;
  const bool by_inkwell = (device.style & 4) && !(device.style & 2);
  return by_inkwell && !device.in_inkwell ? 0x5002 : 0x5001;
}
#endif
void hdUpdateCalibration(unsigned style) {
  const Guard lock(mutex);
  Behind* known = behind_of(current);
  if (!known) return push(0x104);
  FakeHdDevice& device = device_of(*known);
  if (known->in_frame) violated("a calibration within a frame");
  if (style != 1 && style != 2 && style != 4) violated("a calibration of no one style");
  if (!(static_cast<int>(style) & device.style)) violated("a calibration of a style that it does not have");
  if (style == 1 && fake().running) violated("an encoder reset while the scheduler runs");
  if (style == 4 && !fake().running) violated("an inkwell's calibration before the scheduler runs");
  ++device.updates;
  device.calibrated = true;
}
unsigned long hdScheduleAsynchronous(Callback called, void* data, unsigned short priority) {
  const Guard lock(mutex);
  if (callback) violated("scheduled twice");
  if (priority != 0x7FFF) violated("another priority than the default one");
  callback_data = data;
  callback = called;
  fake().scheduled = true;
  return 7;
}
void hdUnschedule(unsigned long handle) {
  const Guard lock(mutex);
  if (handle != 7 || !callback) violated("unscheduled what was not");
  if (fake().running) violated("unscheduled while the scheduler runs");
  callback = nullptr;
  fake().scheduled = false;
}
void hdStartScheduler() {
  const Guard lock(mutex);
  if (fake().running) return violated("started twice");
  if (!callback) violated("started before anything is scheduled");
  if (current == kBadHandle) violated("started without a device");
  // joins a scheduler that hung when it was stopped and has returned since
  if (scheduler.joinable()) scheduler.join();
  fake().running = true;
  stop_scheduler = false;
  scheduler = std::thread(schedule_for_ever);
}
void hdStopScheduler() {
  if (!fake().running) return violated("stopped what does not run");
  while (fake().stop_hangs) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  stop_scheduler = true;
  if (!fake().hangs && scheduler.joinable()) scheduler.join();
  fake().running = false;
}

}  // extern "C"
