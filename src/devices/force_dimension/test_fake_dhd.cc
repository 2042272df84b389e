#include "force_dimension/test_fake_dhd.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <mutex>
#include <new>
#include <optional>

#include "palpate/base/clock.h"
#include "palpate/device/simulated_device.h"

/// Fake of Force Dimension's library. It counts violations of the documentation: calls for a device that is
/// not open, concurrent calls of two threads for one device (except enabling and disabling forces), forces
/// while the library moves the arm, a non-finite force, closing with forces enabled or while the library
/// moves the arm; and violations of palpate's own rule that forces disabled by the operator are not enabled.
namespace palpate::testing {
namespace {

// timeout of the device's watchdog
constexpr std::int64_t kWatchdog_ns = 300'000'000;

FakeDhd& fake() {
  static FakeDhd one;
  return one;
}

void violated(const char* rule) {
  if (fake().violations.fetch_add(1) == 0) fake().first_violation = rule;
}

bool by_hand(int cause) {
  return cause == 1 || cause >= 5;
}

SimulatedDevice hand_of(const FakeDhdDevice& device) {
  SimulatedDevice hand({"light", 0.01, 0, 0, 0, 1e9, 1e9}, {"still", 0.01, 12.6, 2000});
  hand.reset(Point<Device>(device.intended_x_mm, device.intended_y_mm, device.intended_z_mm));
  return hand;
}

/// Internal state of the library for a device.
struct Behind {
  bool open = false, moves = false;
  std::atomic<bool> gone{false};  ///< Disconnected since it was opened
  std::atomic<int> inside{0};
  std::mutex mutex;  // protects the following members
  std::optional<SimulatedDevice> hand;
  DeviceCommand acting;
  std::int64_t advanced_ns = 0, spoken_ns = 0;
  int off_cause = 4;
  bool on = false;
};
std::array<Behind, 4> behind;
thread_local int last_error = 0;

int failed(int error) {
  last_error = error;
  return -1;
}

/// A call for a device. Not ok(): it fails.
class Call {
 public:
  explicit Call(char id, bool from_any_thread = false) : any_(from_any_thread) {
    if (id < 0 || id >= 4) return;
    known_ = &behind[static_cast<std::size_t>(id)];
    device_ = &fake().device[static_cast<std::size_t>(id)];
    if (!any_ && known_->inside.fetch_add(1) > 0) violated("two threads in calls about one device");
    // the call that disables forces may come after closing
    if (!known_->open && !any_) violated("a call about a device that is not open");
    if (!device_->plugged) known_->gone = true;
  }
  ~Call() {
    if (known_ && known_->gone) device_->force_N = 0;
    if (known_ && !any_) known_->inside.fetch_sub(1);
  }
  Call(const Call&) = delete;
  Call& operator=(const Call&) = delete;
  bool ok() const { return known_ && known_->open && !known_->gone && !device_->fails; }
  Behind& known() { return *known_; }
  FakeDhdDevice& device() { return *device_; }

 private:
  const bool any_;
  Behind* known_ = nullptr;
  FakeDhdDevice* device_ = nullptr;
};

// advances the hand and the device's own behaviour; requires the mutex
void resume(Behind& known, FakeDhdDevice& device) {
  const std::int64_t now_ns = monotonic_ns();
  if (const int trip = device.trip.exchange(0)) {
    if (known.on || by_hand(trip) || !by_hand(known.off_cause)) known.off_cause = trip;
    known.on = false;
  }
  if (device.restored.exchange(false) && by_hand(known.off_cause)) {
    known.on = true;
    known.off_cause = 4;
  }
  if (known.on && now_ns - known.spoken_ns > kWatchdog_ns) {
    known.on = false;
    known.off_cause = 3;
  }
  const bool acts = known.on && device.power && device.plugged;
  const DeviceCommand acting = acts ? known.acting : DeviceCommand{};
  device.force_N = acting.force_N.norm();
  device.forces_on = known.on;
  known.hand->intend(Point<Device>(device.intended_x_mm, device.intended_y_mm, device.intended_z_mm));
  const double passed_s = std::min(1e-9 * static_cast<double>(now_ns - known.advanced_ns), 0.1);
  if (passed_s > 0) known.hand->advance(acting, passed_s);
  known.advanced_ns = now_ns;
}

int open_one(char id) {
  if (id < 0 || id >= fake().count) return failed(15);
  FakeDhdDevice& device = fake().device[static_cast<std::size_t>(id)];
  Behind& known = behind[static_cast<std::size_t>(id)];
  if (known.open) {
    violated("opened twice");
    return failed(20);
  }
  if (!device.plugged) return failed(5);
  if (device.in_use) return failed(20);
  if (device.fails) return failed(2);
  const std::lock_guard lock(known.mutex);
  known.open = true;
  known.gone = false;
  known.moves = known.on = false;
  // the device's own switch is unaffected
  if (!by_hand(known.off_cause)) known.off_cause = 4;
  known.acting = {};
  known.hand.emplace(hand_of(device));
  known.advanced_ns = known.spoken_ns = monotonic_ns();
  device.max_force_N = -1;
  device.gravity = -1;
  ++device.opened;
  return id;
}

int close_one(char id) {
  Call call(id);
  if (!call.known().open) return failed(15);
  const std::lock_guard lock(call.known().mutex);
  if (call.ok() && call.known().on) violated("closed with forces on");
  if (call.ok() && call.known().moves) violated("closed while the library moves the arm");
  call.known().open = false;
  // a device that cannot be reached releases by itself
  if (!call.ok()) call.device().force_N = 0;
  return 0;
}

void reset_all() {
  fake().count = 1;
  fake().auto_init_fails = false;
  fake().violations = 0;
  fake().first_violation = "";
  for (Behind& known : behind) known.off_cause = 4;
  for (FakeDhdDevice& device : fake().device) {
    device.~FakeDhdDevice();
    new (&device) FakeDhdDevice;
  }
}

}  // namespace
}  // namespace palpate::testing

using palpate::testing::behind;
using palpate::testing::Behind;
using palpate::testing::Call;
using palpate::testing::failed;
using palpate::testing::fake;
using palpate::testing::violated;

extern "C" {

palpate::testing::FakeDhd* palpate_fake_dhd() {
  fake().reset = palpate::testing::reset_all;
  return &fake();
}

int dhdGetDeviceCount() {
  int count = 0;
  for (int d = 0; d < fake().count; ++d) count += fake().device[static_cast<std::size_t>(d)].plugged;
  return count;
}
int dhdOpenID(char id) {
  return palpate::testing::open_one(id);
}
int dhdClose(char id) {
  return palpate::testing::close_one(id);
}
#ifndef PALPATE_FAKE_WITHOUT_DRD
int drdOpenID(char id) {
  return palpate::testing::open_one(id);
}
int drdClose(char id) {
  return palpate::testing::close_one(id);
}
bool drdIsInitialized(char id) {
  Call call(id);
  return call.ok() && call.device().initialised;
}
int drdAutoInit(char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  // the motion does not end by itself on failure
  call.known().moves = true;
  if (fake().auto_init_fails) return failed(12);
  call.device().initialised = true;
  ++call.device().auto_inits;
  return 0;
}
int drdStop(bool forces, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  call.known().moves = false;
  const std::lock_guard lock(call.known().mutex);
  call.known().on = forces;
  call.known().spoken_ns = palpate::monotonic_ns();
  return 0;
}
#endif
int dhdGetSystemType(char id) {
  Call call(id);
  return call.ok() ? call.device().type.load() : failed(2);
}
int dhdGetPositionAndOrientationFrame(double* x, double* y, double* z, double frame[3][3], char id) {
  Call call(id);
  if (!call.ok() || call.device().mute) return failed(2);
  const std::lock_guard lock(call.known().mutex);
  if (call.device().old) {
    *x = *y = *z = std::nan("");
    return 1;
  }
  resume(call.known(), call.device());
  const palpate::DeviceSample sample = call.known().hand->read();
  *x = call.device().nowhere ? std::nan("") : sample.tip.x() * 1e-3;
  *y = sample.tip.y() * 1e-3;
  *z = sample.tip.z() * 1e-3;
  const double c = std::cos(call.device().turned_rad), s = std::sin(call.device().turned_rad);
  const double turn[3][3] = {{c, -s, 0}, {s, c, 0}, {0, 0, 1}};
  for (int r = 0; r < 3; ++r)
    for (int k = 0; k < 3; ++k) frame[r][k] = call.device().crooked ? 1 : turn[r][k];
  return 0;
}
int dhdGetLinearVelocity(double* x, double* y, double* z, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  const std::lock_guard lock(call.known().mutex);
  if (call.device().says_velocity) {
    *x = call.device().velocity_x_m_s;
    *y = call.device().velocity_y_m_s;
    *z = call.device().velocity_z_m_s;
    return 0;
  }
  const auto velocity = call.known().hand->true_velocity_mm_s();
  *x = velocity.x() * 1e-3;
  *y = velocity.y() * 1e-3;
  *z = velocity.z() * 1e-3;
  return 0;
}
int dhdGetGripperAngleRad(double* angle, char id) {
  Call call(id);
  const int type = call.device().type;
  if (!call.ok() || (type != 35 && type != 37 && type != 104 && type != 105)) return failed(6);
  *angle = call.device().gripper_rad;
  return 0;
}
unsigned dhdGetButtonMask(char id) {
  Call call(id);
  return call.ok() ? call.device().buttons.load() : 0;
}
int dhdEnableForce(unsigned char on, char id) {
  Call call(id, true);
  if (!call.ok()) return failed(2);
  const std::lock_guard lock(call.known().mutex);
  if (on && !call.known().on) call.known().spoken_ns = palpate::monotonic_ns();
  // forces disabled at the device have to be enabled there
  if (on && !call.known().on && palpate::testing::by_hand(call.known().off_cause)) {
    violated("forces asked for that a hand has switched off");
    return 0;
  }
  if (!on && call.known().on) call.known().off_cause = 4;
  call.known().on = on != 0;
  call.device().forces_on = call.known().on;
  if (!on) call.device().force_N = 0;
  return 0;
}
int dhdStop(char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  const std::lock_guard lock(call.known().mutex);
  if (call.known().on) call.known().off_cause = 4;
  call.known().on = false;
  call.device().force_N = 0;
  call.device().forces_on = false;
  ++call.device().brakes;
  return 0;
}
int dhdSetForceAndTorqueAndGripperForce(double fx, double fy, double fz, double tx, double ty, double tz,
                                        double gripper, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  if (call.device().deaf) return failed(2);
  if (call.known().moves) violated("a force while the library moves the arm");
  for (const double each : {fx, fy, fz, tx, ty, tz, gripper})
    if (!std::isfinite(each)) violated("a force that is no number");
  const std::lock_guard lock(call.known().mutex);
  auto& device = call.device();
  device.requested_x_N = fx;
  device.requested_y_N = fy;
  device.requested_z_N = fz;
  device.requested_x_Nm = tx;
  device.requested_y_Nm = ty;
  device.requested_z_Nm = tz;
  device.requested_gripper_N = gripper;
  palpate::Vector<palpate::Device> force(fx, fy, fz);
  device.largest_N = std::max(device.largest_N.load(), force.norm());
  if (device.max_force_N > 0 && force.norm() > device.max_force_N)
    force = force.normalized() * device.max_force_N;
  call.known().acting.force_N = force;
  call.known().spoken_ns = palpate::monotonic_ns();
  resume(call.known(), device);
  ++device.forces;
  return device.saturated ? 2 : 0;
}
int dhdSetMaxForce(double newton, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  call.device().max_force_N = newton;
  return 0;
}
double dhdGetMaxForce(char id) {
  Call call(id);
  return call.ok() ? call.device().max_force_N.load() : -1;
}
int dhdGetStatus(int* status, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  const std::lock_guard lock(call.known().mutex);
  resume(call.known(), call.device());
  // more fields than version 3.17 has
  std::fill_n(status, 24, 0);
  status[0] = call.device().power;
  status[1] = call.device().plugged;
  status[2] = 1;
  status[3] = call.device().initialised;
  status[5] = call.known().on;
  status[9] = call.device().error;
  status[14] = call.known().on ? 0 : call.known().off_cause;
  return 0;
}
const char* dhdErrorGetLastStr() {
  return palpate::testing::last_error == 20 ? "device in use" : "communication error";
}
void dhdGetSDKVersion(int* major, int* minor, int* release, int* revision) {
  *major = 3;
  *minor = 17;
  *release = 6;
  *revision = 1;
}
bool dhdHasActiveWrist(char id) {
  Call call(id);
  return call.ok() && (call.device().type == 104 || call.device().type == 105);
}
#ifndef PALPATE_FAKE_TOO_OLD
bool dhdHasActiveGripper(char id) {
  Call call(id);
  const int type = call.device().type;
  return call.ok() && (type == 35 || type == 37 || type == 104 || type == 105);
}
bool dhdIsLeftHanded(char id) {
  Call call(id);
  return call.ok() && call.device().left;
}
#endif
int dhdSetGravityCompensation(int on, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  call.device().gravity = on;
  return 0;
}
int dhdSetEffectorMass(double kilogram, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  call.device().held_kg = kilogram;
  return 0;
}
int dhdGetSerialNumber(unsigned short* serial, char id) {
  Call call(id);
  if (!call.ok()) return failed(2);
  *serial = call.device().serial;
  return 0;
}

}  // extern "C"
