#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "palpate/device/device.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"
#include "palpate/haptics/haptics.h"
#include "palpate/tissue/removal.h"

/// The tick: (Model, SessionState, DeviceStates, Parameters, dt) -> (SessionState, Wrenches).
namespace palpate {

/// What one device may be sent. kNotKnown where nobody knows: then the user's limit alone holds for forces,
/// and torques and the gripper, for which the user sets no limit, stay off.
struct OutputLimits {
  double peak_force_N = kNotKnown;
  double continuous_force_N = kNotKnown;  ///< of the thermal budget; unknown: there is none
  double peak_torque_Nmm = kNotKnown;
  double peak_gripper_N = kNotKnown;
  /// Most change of force. A wall of 2 N/mm met at half a metre a second asks for 1000 N/s.
  double slew_N_per_s = 2000;
};
OutputLimits limits_of(const DeviceInfo& info);
/// N/mm of the device that its maker vouches for: infinite where that is not known, 0 for what is no
/// stiffness (negative, not a number).
double vouched_stiffness_N_per_mm(const DeviceInfo& info);

/// Inputs of a tick that belong to one device.
struct DeviceParameters {
  double force_gain = 1;  ///< N at the device for one N in the patient (WorkspaceSettings::force_gain)
  double scale = 1;  ///< mm in the patient for one mm of the device; torques shrink with it, as the tool does
  OutputLimits limits;
  /// What a hand holds with the device, N/mm of the device, and no more than what its maker vouches for.
  /// Stiffer tissues are felt as this stiff: by the proxy each for itself, by the direct methods all softer
  /// by one factor.
  double most_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
  double position_step_mm = kNotKnown;  ///< of its encoders: less is no motion to the passivity controller
  /// Damping that the device bears, N s/mm of the device: more of a tissue's viscosity, the published
  /// friction's and the coupling's is felt as so much. Not above 0 or not a number: nothing is known of it,
  /// and nothing clamped.
  double most_damping_N_s_per_mm = kNotKnown;
  /// From a command to its force, s. The passivity observer counts with it; what is not known counts as none.
  double delay_s = 0;
};
/// What is known of a device alone: as stiff as its maker vouches for, which a hand need not hold.
DeviceParameters device_parameters(const DeviceInfo& info, const WorkspaceSettings& settings);

/// Inputs of a tick that may change while the loop runs. A change of method, switch or gain is felt as a
/// blend over kBlend_s, not as a step.
struct Parameters {
  /// Trilinear where the model is not prepared for it (kFlagMethodMissing).
  ForceMethod method = ForceMethod::kTrilinear;
  bool friction = true;
  bool viscosity = true;
  bool passivity = true;        ///< what gives out more energy than it got is damped; observed in any case
  bool paused = false;          ///< forces fade out and stay off
  bool emergency_stop = false;  ///< forces are off at once
  bool motor = false;           ///< of a tool that cuts, beside its pedal; without force it stands still
  double max_force_N = 3.0;     ///< the user's limit, beside the scene's; not finite or negative counts as 0
  std::array<DeviceParameters, kMaxDevices> device;
  /// Rotation of the object about World's origin; commanded about 10 times a second.
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
};

/// TickSwitch bits.
std::uint8_t switches_of(const Parameters& parameters);

/// A change of model, method or parameters is spread over this time.
inline constexpr double kBlend_s = 0.1;
inline constexpr double kRampIn_s = 0.5;   ///< from nothing to full force, at the start and after every fault
inline constexpr double kRampOut_s = 0.1;  ///< from full force to nothing, before a pause or the end
/// Time constant with which the stiffness that is felt follows that of the surfaces touched.
inline constexpr double kSeam_s = 0.015;

/// What the output stage remembers of one device.
struct OutputState {
  Wrench sent;
  double gain = 0;         ///< of the ramp, 0 ... 1
  double heat = 0;         ///< part of the thermal budget that is used, 0 ... 1
  double whole_s = 0;      ///< since the last fault or dropout; not counted beyond the ramp's time
  bool away = false;       ///< no fresh pose now, for a short time yet: the gain waits
  bool returning = false;  ///< one has come again: the force grows slowly for a while
};

/// What the spring and the damper between tip and proxy remember.
struct CouplingState {
  double stiffness_N_per_mm = 0;  ///< that is felt; 0: without contact
  Vector<Patient> pull_mm;        ///< from the tip to the proxy
  VelocityWindow pull_velocity;   ///< of its change, free space included; empty without damping
};

/// What the passivity observer remembers of one device.
struct PassivityState {
  double energy_mJ = 0;  ///< that the hand has put in and not got back; below 0: it got more
  // the way along the force since a speed was told last, its time, and that speed
  double way_mm = 0, time_s = 0, speed_mm_s = 0;
  // how far within less than a step of its encoder the tip is, and whether it went with the force last
  double play_mm = 0;
  bool gives_way = false;
};

/// What tells a hand that swings by itself (src/servo/swing.h).
struct SwingState {
  Vector<World> axis;             ///< of the last force
  double way_mm = 0, time_s = 0;  ///< along it since the last turn
  double farthest_mm = 0, farthest_s = 0;
  Vector<World> aside_mm;  ///< likewise, to the sides
  double before_mm = 0;    ///< length of the half swing before
  int halves = 0;          ///< of a swing by itself, one after the other
  double free_s = 0;       ///< out of contact
  double later_s = 0;      ///< that the force is taken to act later than is known
};

/// What was sent and has not acted yet, where a device's delay is known. Oldest first.
struct DelayLine {
  struct Held {
    Vector<World> force_N;
    double time_s = 0;
  };
  std::array<Held, 64> held;
  int count = 0;
};

/// Everything a tick remembers. Small, copyable, hashable; no pointers.
struct SessionState {
  struct Hand {
    bool seen = false;  ///< a previous tip exists
    Point<World> previous_world;
    Point<Patient> previous_tip;
    VelocityWindow velocity;
    ProxyState proxy;
    std::uint32_t proxy_version = 0;  ///< of the model whose surfaces it is on
    bool held_directly = false;       ///< a direct method pushed the tip in the tick before
    CouplingState coupling;
    BurrState burr;  ///< of a tool that is none as at the beginning
    // what the force was last, and what is left of the difference to what made it
    Wrench asked;
    Wrench difference;
    double blend_elapsed_s = kBlend_s;
    PassivityState passivity;
    SwingState swing;
    DelayLine delay;
    double turned_mJ = 0;  ///< work that the turning object has done on the hand since the run began
    OutputState output;
  };

  std::uint64_t tick = 0;
  double time_s = 0;
  // object rotation, interpolated over kRotationInterval from each command
  Eigen::Quaterniond rotation_start = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_felt = Eigen::Quaterniond::Identity();
  double rotation_elapsed_s = 1.0;
  // what made the last forces, 0 before the first tick: another value starts a blend
  std::uint64_t made_by = 0;
  // of tools that cut: how often a motor was switched on while all were off, and whether one is on
  std::uint32_t strokes = 0;
  bool motor_on = false;
  std::array<Hand, kMaxDevices> hands;
  /// Those of the model of the last tick, by which a new version's are told from other ones. They follow from
  /// that version, which the hash knows.
  struct Surfaces {
    std::uint32_t version = 0;  ///< of that model, 0 before the first tick
    std::uint32_t edits = 0;    ///< likewise
    int count = 0;
    std::array<LabelId, kMostSurfaces> label{};
    std::array<std::uint64_t, kMostSurfaces> content{};  ///< Surface::content_hash()
  } surfaces;

  /// 64-bit hash of the state, equal for equal states on every build.
  std::uint64_t hash(int devices) const;
};
inline constexpr double kRotationInterval_s = 0.1;

/// One servo tick. Allocates, locks, logs, throws nothing and makes no system call.
/// @param devices  1 ... kMaxDevices states; `wrenches` has the same length
/// @param record   filled with what the tick took in and gave out
void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record);

}  // namespace palpate
