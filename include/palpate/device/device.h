#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>

#include "palpate/base/result.h"
#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

/// The device port: the interface between drivers and the servo. States in, wrenches out.
namespace palpate {

/// Monotonic clock, ns. Called by any thread, including the servo's, so it must not block.
using TimeSource = std::int64_t (*)() noexcept;

/// Conditions, besides the pose itself, under which a device gets no force, or a new contact. Bits.
enum DeviceStatus : std::uint32_t {
  /// Caused by the device: brake, dead man's switch, over-temperature, lost connection
  kDeviceFault = 1u << 0,
  kDeviceClutched = 1u << 1,  ///< Clutch held: the tip stays in place while the hand moves
  kDeviceHalted = 1u << 2,    ///< The watchdog halted it
  /// The tip was set down at its position, as by a pointer: there is no path to it, and its contact is reset
  kDeviceSetDown = 1u << 3,
};

/// Sample that a driver reads from one device, in the device's own frame.
struct DeviceSample {
  Point<Device> tip;  ///< mm
  Eigen::Quaterniond R_DeviceTool = Eigen::Quaterniond::Identity();
  /// Velocities estimated by the device; kNoValue if it provides none.
  Vector<Device> velocity_mm_s{kNoValue, kNoValue, kNoValue};
  Vector<Device> angular_velocity_rad_s{kNoValue, kNoValue, kNoValue};
  double gripper_rad = kNoValue;
  std::uint32_t buttons = 0;  ///< Bit n: button n is held
  bool fault = false;         ///< The device withholds forces by itself
  bool set_down = false;      ///< There is no path from the previous pose to this one (kDeviceSetDown)
  /// Time of the pose, ns of CLOCK_MONOTONIC. If it is not known exactly, the earliest possible time (for a
  /// request and its reply, the sending). A time more than a millisecond in the future gets no force.
  std::int64_t taken_ns = 0;
};

/// Command that a driver sends to one device, in the device's own frame.
struct DeviceCommand {
  Vector<Device> force_N;
  Vector<Device> torque_Nmm;  ///< About the tip
  double gripper_N = 0;       ///< Above 0 opens
};

/// State of one device as input of a tick: the sample mapped to the workspace.
struct DeviceState {
  Point<World> tip;  ///< mm
  Eigen::Quaterniond R_WorldTool = Eigen::Quaterniond::Identity();
  /// Velocities estimated by the device; kNoValue if it provides none. The tick measures the tip's velocity
  /// itself.
  Vector<World> velocity_mm_s{kNoValue, kNoValue, kNoValue};
  Vector<World> angular_velocity_rad_s{kNoValue, kNoValue, kNoValue};
  double gripper_rad = kNoValue;
  std::uint32_t buttons = 0;  ///< Bit n: button n is held
  std::uint32_t status = 0;   ///< DeviceStatus bits
  double age_s = 0;           ///< Age of the pose
};

/// Output of a tick for one device: force and torque about the tip, as rendered to the operator, in World
/// axes.
struct Wrench {
  Vector<World> force_N;
  Vector<World> torque_Nmm;
  double gripper_N = 0;  ///< Above 0 opens
};

/// Properties of a device; unknown ones are empty, not zero.
struct DeviceInfo {
  /// Trigger of the driver's update. Each kind keeps its own clock and adds no delay.
  enum class Drive : std::uint8_t {
    /// The servo thread reads and writes at the loop's rate (Force Dimension, the simulated device)
    kPulled,
    kCallback,  ///< The vendor's scheduler calls back inside its own frame (OpenHaptics)
    kExchange,  ///< One request, one reply: each round trip is a tick (Haply)
  };
  /// Reachable box.
  struct Workspace {
    Point<Device> low, high;  ///< Opposite corners, mm
  };
  std::string name;
  Drive drive = Drive::kPulled;
  bool simulated = false;
  std::optional<double> peak_force_N;
  std::optional<double> continuous_force_N;
  std::optional<double> peak_torque_Nmm;
  std::optional<double> peak_gripper_N;
  std::optional<double> position_step_mm;            ///< Encoder resolution
  std::optional<double> stiffness_N_per_mm;          ///< Largest stiffness that the vendor vouches for
  std::optional<double> rate_hz;                     ///< Rate of the device's own clock
  std::optional<double> delay_s;                     ///< Delay from a command to its force
  std::optional<double> mass_kg, damping_N_s_per_m;  ///< Effective mass and damping of the arm at the tip
  std::optional<Workspace> workspace;
  int degrees_of_freedom_in = 3;
  int degrees_of_freedom_out = 3;
  int buttons = 0;
  bool gripper = false;
  bool moves_by_itself = false;  ///< Calibration moves the arm, which requires the user's consent
  /// Samples are positions in the patient (Patient, LPS), as of a tracked tool. They are not mapped by a
  /// workspace, and the tip moves with the object when it is rotated.
  bool in_patient = false;
  /// Orientation of the device's axes in the workspace, before the user's yaw.
  Rotation<World, Device> R_WorldDevice;
};

// Device axes of each vendor in World; the comments give the World components of a vector (x, y, z) in the
// vendor's axes.
Rotation<World, Device> openhaptics_axes();      ///< (x, -z, y): right, up, towards the user
Rotation<World, Device> force_dimension_axes();  ///< (y, -x, z): towards the user, right, up
Rotation<World, Device> haply_axes();            ///< (x, y, z): the same as World

/// Precondition of DeviceDriver::open(): consent to an arm that moves by itself and may hit a person. Errors:
/// kUsage without it.
Result<void> require_consent(const DeviceInfo& info, bool may_move);

/// The servo as a driver calls it, once per update, on the thread that owns the driver's clock.
class ServoFunction {
 public:
  virtual ~ServoFunction() = default;
  /// @param samples   one per device of the driver, in the order of DeviceDriver::devices()
  /// @param commands  receives one command per device
  virtual void update(std::span<const DeviceSample> samples, std::span<DeviceCommand> commands) noexcept = 0;
};

/// Clock of the servo's own thread, for drivers without one.
class ServoClock {
 public:
  virtual ~ServoClock() = default;
  /// Sleeps until the next tick is due. Returns false if a stop was requested.
  virtual bool wait() noexcept = 0;
  virtual bool stopped() const noexcept = 0;
};

/// A driver of one or more devices that share a clock. run() supports every kind of Drive:
///
///   pulled     while (clock.wait())     { read; servo.update(...); write; }
///   callback   register a callback that calls servo.update inside the vendor's frame; sleep until
///              clock.stopped(); unregister
///   exchange   while (!clock.stopped()) { send commands, await the reply; servo.update(...); }
class DeviceDriver {
 public:
  virtual ~DeviceDriver() = default;
  /// Devices, 1 ... kMaxDevices; complete once open() has succeeded.
  virtual std::span<const DeviceInfo> devices() const = 0;
  /// Index of the device whose clock the driver ticks by.
  virtual std::size_t clock_owner() const { return 0; }
  /// Connects and calibrates; no effect once it has succeeded. Errors: kUnavailable; kUsage if an arm would
  /// move by itself without consent.
  /// @param may_move  the user has consented to an arm that moves by itself
  virtual Result<void> open(bool may_move) = 0;
  /// Calls `servo` once per update until `clock` is stopped, then sends zeros. Runs on the servo thread.
  virtual void run(ServoFunction& servo, ServoClock& clock) noexcept = 0;
  /// Sends zeros to the devices from now on, regardless of what update() returns. Any thread, at any time,
  /// including while the servo thread hangs: the watchdog calls it.
  virtual void halt() noexcept = 0;
  /// Ends halt(), and halts received by halt_fd() up to the given number. A newer one stays in force, even
  /// if the device receives it first.
  /// @param newest  number of the newest halt to end (Heartbeat::newest_halt); 0: none
  virtual void resume(std::uint64_t newest) noexcept = 0;
  /// File descriptor of a pipe for devices that another process holds; -1: the devices are held by this
  /// process. Writing to it, from any process, halts the devices like halt(), even after this process has
  /// ended. The data written is the halt's number, eight bytes in native byte order;
  /// Heartbeat::kPermanentHalt, and hang-up of all writers, halt permanently. The device reads all pending
  /// numbers before it acts on a command, and exerts no force while the largest number read is above every
  /// number that resume() has ended. Open from construction to destruction.
  virtual int halt_fd() const noexcept { return -1; }
  /// Why a device currently provides no force or no pose, with its remedy, for the user: a lost connection,
  /// an engaged brake. Empty: no problem. Any thread but the servo's; may block briefly.
  virtual std::optional<Error> failure() const { return std::nullopt; }
};

}  // namespace palpate
