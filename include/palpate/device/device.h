#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

/// The device port: states in, wrenches out.
namespace palpate {

/// What time it is, ns, never set back. Called by any thread, the servo's too, where it waits for nothing.
using TimeSource = std::int64_t (*)() noexcept;

/// Reasons why a device gets no force, besides what its pose says. Bits.
enum DeviceStatus : std::uint32_t {
  kDeviceFault = 1u << 0,     ///< its own doing: brake, dead man's switch, over-temperature, lost connection
  kDeviceClutched = 1u << 1,  ///< the clutch is held: the tip rests where it is while the hand moves on
  kDeviceHalted = 1u << 2,    ///< the watchdog stopped it
};

/// What a driver reads from one device, in that device's own frame.
struct DeviceSample {
  Point<Device> tip;  ///< mm
  Eigen::Quaterniond R_DeviceTool = Eigen::Quaterniond::Identity();
  /// The device's own estimates; kNotKnown when it has none.
  Vector<Device> velocity_mm_s{kNotKnown, kNotKnown, kNotKnown};
  Vector<Device> angular_velocity_rad_s{kNotKnown, kNotKnown, kNotKnown};
  double gripper_rad = kNotKnown;
  std::uint32_t buttons = 0;  ///< bit n: button n is held
  bool fault = false;         ///< the device withholds forces by itself
  /// When the pose was true, ns of CLOCK_MONOTONIC; where that is not known, the earliest time at which it
  /// can have been (of a request and its reply, the sending). One from the future, by more than a
  /// millisecond, gets no force.
  std::int64_t taken_ns = 0;
};

/// What a driver sends to one device, in that device's own frame.
struct DeviceCommand {
  Vector<Device> force_N;
  Vector<Device> torque_Nmm;  ///< about the tip
  double gripper_N = 0;       ///< > 0 opens
};

/// What one tick is told of a device: the sample mapped to the workspace.
struct DeviceState {
  Point<World> tip;  ///< mm
  Eigen::Quaterniond R_WorldTool = Eigen::Quaterniond::Identity();
  /// As the device estimates them; kNotKnown when it does not. The tick measures the tip's velocity itself.
  Vector<World> velocity_mm_s{kNotKnown, kNotKnown, kNotKnown};
  Vector<World> angular_velocity_rad_s{kNotKnown, kNotKnown, kNotKnown};
  double gripper_rad = kNotKnown;
  std::uint32_t buttons = 0;  ///< bit n: button n is held
  std::uint32_t status = 0;   ///< DeviceStatus bits
  double age_s = 0;           ///< how long ago the pose was true
};

/// What a tick answers: a force and a torque about the tip, as the hand shall feel them, along World's axes.
struct Wrench {
  Vector<World> force_N;
  Vector<World> torque_Nmm;
  double gripper_N = 0;  ///< > 0 opens
};

/// What is known about a device; what is not known is empty, not zero.
struct DeviceInfo {
  /// How the device's update comes about; each keeps its own clock and adds no delay.
  enum class Drive : std::uint8_t {
    kPulled,    ///< our thread reads and writes it at our rate (Force Dimension, the simulated device)
    kCallback,  ///< the vendor's scheduler calls us inside its own frame (OpenHaptics)
    kExchange,  ///< one request, one reply: the round trip is the tick (Haply)
  };
  struct Workspace {
    Point<Device> low, high;  ///< corners of the box that can be reached, mm
  };
  std::string name;
  Drive drive = Drive::kPulled;
  bool simulated = false;
  std::optional<double> peak_force_N;
  std::optional<double> continuous_force_N;
  std::optional<double> peak_torque_Nmm;
  std::optional<double> peak_gripper_N;
  std::optional<double> position_step_mm;            ///< encoder resolution
  std::optional<double> stiffness_N_per_mm;          ///< the most that the maker vouches for
  std::optional<double> rate_hz;                     ///< of its own clock
  std::optional<double> delay_s;                     ///< from a command to its force
  std::optional<double> mass_kg, damping_N_s_per_m;  ///< of the arm, as the tip feels them
  std::optional<Workspace> workspace;
  int degrees_of_freedom_in = 3;
  int degrees_of_freedom_out = 3;
  int buttons = 0;
  bool gripper = false;
  bool moves_by_itself = false;  ///< calibration moves the arm: needs the user's consent
  /// Its samples are places in the patient (Patient, LPS): a tracked tool's. No workspace maps them, and the
  /// tip goes along where the object is turned.
  bool in_patient = false;
  /// The device's axes in the workspace, before the user turns it.
  Rotation<World, Device> R_WorldDevice;
};

/// The makers' axes in World. A vector (x, y, z) of theirs is
Rotation<World, Device> openhaptics_axes();      ///< (x, -z, y): theirs are right, up, to the user
Rotation<World, Device> force_dimension_axes();  ///< (y, -x, z): theirs are to the user, right, up
Rotation<World, Device> haply_axes();            ///< (x, y, z): theirs are World's

/// What open() asks first: an arm that moves by itself may hit somebody. Errors: kUsage.
Result<void> require_consent(const DeviceInfo& info, bool may_move);

/// States in, wrenches out: what every driver calls once an update, in whichever thread owns its clock.
class ServoFunction {
 public:
  virtual ~ServoFunction() = default;
  /// @param samples   one for each device of the driver, in the order of DeviceDriver::devices()
  /// @param commands  filled, one for each
  virtual void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept = 0;
};

/// The clock of the servo's own thread, for drivers that have none.
class ServoClock {
 public:
  virtual ~ServoClock() = default;
  /// Sleeps until the next tick is due. False: stop was asked.
  virtual bool wait() noexcept = 0;
  virtual bool stopped() const noexcept = 0;
};

/// A driver: one or more devices that share a clock. run() fits every kind:
///
///   pulled     while (clock.wait())     { read; servo.update(...); write; }
///   callback   register a callback that calls servo.update inside the vendor's frame; sleep until
///              clock.stopped(); unregister
///   exchange   while (!clock.stopped()) { send commands, await the reply; servo.update(...); }
class DeviceDriver {
 public:
  virtual ~DeviceDriver() = default;
  /// At least one and at most kMaxDevices; complete once open() has succeeded.
  virtual std::span<const DeviceInfo> devices() const = 0;
  /// The one whose clock the driver ticks by.
  virtual std::size_t clock_owner() const { return 0; }
  /// Connects and calibrates; once it has succeeded, another call does nothing. Errors: kUnavailable, kUsage
  /// when an arm would move by itself without consent.
  /// @param may_move  the user has agreed that the arm moves by itself
  virtual Result<void> open(bool may_move) = 0;
  /// Calls `servo` once an update until the clock says stop, then sends zeros. On the servo thread.
  virtual void run(ServoFunction& servo, ServoClock& clock) noexcept = 0;
  /// From now on the devices get zeros, whatever update() answers. Any thread, at any time, also while the
  /// servo thread hangs: the watchdog calls it.
  virtual void halt() noexcept = 0;
  /// Ends halt(), and of the halts that came by halt_file() those up to this number: a newer one stays, also
  /// where the device hears of it first.
  /// @param newest  number of the newest halt that ends (Heartbeat::halts); 0: none
  virtual void resume(std::uint64_t newest) noexcept = 0;
  /// For devices that another process holds: a pipe that, written to by any process, has the same effect
  /// there as halt(), also when this process is gone. What is written is the halt's number, eight bytes as
  /// this machine stores them; Heartbeat::kHaltForGood, and the end of all who could write, is for good.
  /// The device reads all that lies there before it acts on a command, and gives no force while the
  /// largest number that it has read is above every one that resume() has ended. Open from construction to
  /// destruction. -1: the devices live in this process.
  virtual int halt_file() const noexcept { return -1; }
  /// Why a device gives no force or no pose at present, with its cure, for a person: the connection is lost,
  /// its brake is on. Empty: nothing is wrong. Any thread but the servo's; may wait for a moment.
  virtual std::optional<Error> trouble() const { return std::nullopt; }
};

}  // namespace palpate
