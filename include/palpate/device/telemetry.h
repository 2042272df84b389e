#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

/// What one tick took in and gave out, as plain numbers: what the recorder writes, what viewers show.
/// Units are in the names; frames: tip_world and force in World, the rest in Patient.
namespace palpate {

inline constexpr int kMaxDevices = 4;
/// Structures along the tip's way in that a tick tells of.
inline constexpr int kMostTold = 6;
/// Contacts that a tick tells of.
inline constexpr int kMostContactsTold = 6;
/// Structures near the tool that a tick tells of.
inline constexpr std::size_t kMostNearTold = 8;

/// What is not known is not a number.
inline constexpr double kNotKnown = std::numeric_limits<double>::quiet_NaN();

/// Reasons why a tick's output was changed or withheld, and what was met. Bits.
enum TickFlag : std::uint32_t {
  kFlagClamped = 1u << 0,          ///< the force was larger than the limit: lower stiffness or press less
  kFlagNotFinite = 1u << 1,        ///< a state or force was NaN or infinite; the output was zero
  kFlagOutside = 1u << 2,          ///< the tip is outside the volume: free space
  kFlagPaused = 1u << 3,           ///< paused, or about to stop: the force fades out and stays off
  kFlagContact = 1u << 4,          ///< a felt structure is touched
  kFlagRotationIgnored = 1u << 5,  ///< the commanded rotation was no unit quaternion: the last one holds
  kFlagThermal = 1u << 6,          ///< the limit stood below the peak to keep the motors cool
  kFlagSlew = 1u << 7,             ///< the force was on its way to a value too far for one tick
  kFlagRamp = 1u << 8,             ///< faded: coming in over 0.5 s or going out
  kFlagStale = 1u << 9,            ///< the state was older than 5 ms: decaying, and zero from 10 ms
  kFlagJump = 1u << 10,            ///< the tip moved farther in a tick than any hand can; the output was zero
  kFlagDeviceFault = 1u << 11,     ///< the device withholds forces by itself; the output was zero
  kFlagHalted = 1u << 12,          ///< the watchdog had stopped the device; the output was zero
  kFlagEmergencyStop = 1u << 13,   ///< the output was zero
  kFlagClutched = 1u << 14,        ///< the clutch was held: the force fades out and stays off
  kFlagBlend = 1u << 15,           ///< on the way from the force of the last method, model or parameters
  kFlagMethodMissing = 1u << 16,   ///< the model is not prepared for the method: the trilinear one was felt
  kFlagInside = 1u << 17,          ///< the proxy waits: the tip has been inside since contact began anew
  kFlagWedged = 1u << 18,          ///< the tool is wider than the gap that it is in: the proxy stayed
  kFlagRuptured = 1u << 19,        ///< the tool went through a surface
  kFlagPassivity = 1u << 20,       ///< damped, so that the hand gets no more energy than it has put in
  kFlagTurnHeld = 1u << 21,        ///< the object turned slower than it was told, so as not to push the hand
  kFlagNoGo = 1u << 22,            ///< the tool is nearer to a no-go region than it is to keep away
  kFlagRelease = 1u << 23,         ///< the tool left the layer around a structure, whose force fades out
};
/// After these the force is zero at once, and comes back by the ramp.
inline constexpr std::uint32_t kFaultFlags =
    kFlagNotFinite | kFlagJump | kFlagDeviceFault | kFlagHalted | kFlagEmergencyStop;

/// TickRecord::switches. Bits.
enum TickSwitch : std::uint8_t {
  kSwitchFriction = 1u << 0,
  kSwitchViscosity = 1u << 1,
  kSwitchPaused = 1u << 2,
  kSwitchEmergencyStop = 1u << 3,
  kSwitchPassivity = 1u << 4,
  kSwitchMotor = 1u << 5,
};

/// What a burr took with it on a short straight way, in the patient (Sweep, palpate/tissue/sweep.h).
struct SweepRecord {
  std::uint32_t device = 0;  ///< whose burr it was
  std::array<double, 3> from_mm{}, to_mm{};
  double radius_mm = 0;
  std::uint32_t stroke = 0;  ///< counted from the motor's first start
  /// Of a cylinder or cone, and its last ball's; 0: a ball.
  std::array<double, 3> axis_mm{};
  double end_radius_mm = 0;

  friend bool operator==(const SweepRecord&, const SweepRecord&) = default;
};

/// What can become of a burr's stroke, which is what it takes away from its motor's start to its stop.
enum class StrokeAction : std::uint8_t { kUndo, kRedo };

/// The most that Model::tissue_coarsened may be.
inline constexpr double kMostTissueCoarsened = 2;

/// How a version of the model follows from the one before it: a tissue was changed while it was felt, the
/// direct methods' fields were made anew for the stiffnesses as they are, something was cut away, a stroke
/// was undone or done again, or soft tissue goes by another law.
struct ModelChange {
  static constexpr std::uint32_t kFieldsMadeAnew = 0xffffffff;
  static constexpr std::uint32_t kCut = 0xfffffffe;   ///< by the sweeps that were told before it
  static constexpr std::uint32_t kUndo = 0xfffffffd;  ///< of the last stroke (StrokeHistory)
  static constexpr std::uint32_t kRedo = 0xfffffffc;
  static constexpr std::uint32_t kLaw = 0xfffffff0;  ///< plus a TissueLaw: that one from now on
  static constexpr std::uint32_t kLaws = 4;
  std::uint32_t version = 0;  ///< one more than the version before it
  std::uint32_t tissue = 0;   ///< its place in the scene, from 0, or one of the above
  // what the tissue has from that version on; of a law the first is Model::tissue_coarsened, 0: as it was
  double stiffness_N_per_mm = 0, static_friction = 0, dynamic_friction = 0, viscosity_N_s_per_mm = 0;

  bool is_of_tissue() const { return tissue < kLaw; }
  bool is_of_law() const { return tissue >= kLaw && tissue < kLaw + kLaws; }
  bool is_of_stroke() const { return tissue == kUndo || tissue == kRedo; }

  friend bool operator==(const ModelChange&, const ModelChange&) = default;
};

struct DeviceTick {
  // in
  std::array<double, 3> tip_world_mm{};
  std::array<double, 4> orientation_wxyz{1, 0, 0, 0};
  std::array<double, 3> velocity_world_mm_s{kNotKnown, kNotKnown, kNotKnown};  ///< the device's own estimate
  std::array<double, 3> angular_velocity_world_rad_s{kNotKnown, kNotKnown, kNotKnown};  ///< likewise
  double gripper_rad = kNotKnown;
  std::uint32_t buttons = 0;
  std::uint32_t status = 0;  ///< DeviceStatus bits
  double age_s = 0;          ///< of the pose
  // in: DeviceParameters; NaN: not known
  double force_gain = 1, scale = 1;
  double peak_force_N = kNotKnown, continuous_force_N = kNotKnown, peak_torque_Nmm = kNotKnown;
  double peak_gripper_N = kNotKnown, slew_N_per_s = kNotKnown;
  double most_stiffness_N_per_mm = kNotKnown, position_step_mm = kNotKnown;
  double most_damping_N_s_per_mm = kNotKnown;  ///< 0 of recordings before format 4.1: likewise
  double delay_s = 0;
  // out
  std::array<double, 3> force_N{};     ///< sent, World
  std::array<double, 3> torque_Nmm{};  ///< about the tip, World
  double gripper_N = 0;                ///< sent
  double unclamped_force_N = 0;        ///< magnitude before the output stage
  double limit_N = 0;                  ///< least of device, user, scene and thermal limit in this tick
  double heat = 0;                     ///< part of the thermal budget that is used, 0 ... 1
  double energy_mJ = 0;                ///< that the hand has put in and not got back (passivity observer)
  double damping_N_s_per_m = 0;        ///< along the force, added by the passivity controller
  double turned_mJ = 0;  ///< work that the turning object has done on the hand since the run began
  std::array<double, 3> tip_patient_mm{};
  /// Where the proxy is: that of the outermost layer, of a burr that of the layer in which it cuts, which is
  /// where its head is. By a direct method, the tip.
  std::array<double, 3> proxy_patient_mm{};
  std::array<double, 3> normal_patient{};  ///< of all that is leant on, outward, unit; zero in free space
  std::array<double, 3> velocity_patient_mm_s{};  ///< windowed, relative to the object
  double field = 0;                               ///< 0 ... 1; the proxy reads none: 0
  /// ContactSite::depth_mm; NaN: no surface within reach, 0 where nothing is felt. Of the proxy: from it to
  /// the tip.
  double depth_mm = 0;
  std::uint16_t label = 0;  ///< touched structure, 0 none
  /// All that the tool leans on: those of the outermost layer first, in each the strongest first; the first
  /// is that of `label`. Structure, part of the tool (its points, then its capsules), place on the surface,
  /// force along its normal, in the patient. Label 0: no more.
  std::array<std::uint16_t, kMostContactsTold> contact_label{}, contact_part{};
  /// What the force comes from, outermost first: structures along the tip's way in, how much of that way lies
  /// within each, and each one's share of the force, 0 ... 1. By a direct method what is touched, with all of
  /// it. Label 0: no more; none without contact.
  std::array<std::uint16_t, kMostTold> felt_label{};
  /// Structures near the tool, nearest first (nearest_structures). 0: no more.
  std::array<std::uint16_t, kMostNearTold> near_label{};
  /// The no-go region that the tool is deepest in (NoGoForce), by its place in the scene from 1; 0: none.
  std::uint16_t no_go = 0;
  std::array<double, 3 * kMostContactsTold> contact_patient_mm{};
  std::array<double, kMostContactsTold> contact_N{};
  std::array<double, kMostTold> felt_depth_mm{}, felt_share{};
  /// Of each near_label, from the tool's outline to the structure's own surface, below 0 inside.
  std::array<double, kMostNearTold> near_mm{};
  /// How deep the tool is in what no_go is to keep away; and the force of all no-go regions together at the
  /// device, beside what is leant on and before the output stage.
  double no_go_depth_mm = 0, no_go_N = 0;
  std::uint32_t flags = 0;  ///< TickFlag bits
};

struct TickRecord {
  std::uint64_t tick = 0;
  double time_s = 0;  ///< 0 in the first tick, then the sum of the dt_s of the ticks before
  double dt_s = 0;
  double lateness_s = 0;  ///< real clock: how late the tick began; not part of the hash
  double compute_s = 0;   ///< real clock: from reading the states to the commands; not part of the hash
  std::uint32_t model_version = 0;
  std::uint32_t yield_frame = 0;  ///< of tissue that yields: the newest solution (YieldFrame); 0: none yet
  /// How many changes of the parameters, and how many stops and rearms, the loop had heard of. In no
  /// recording, which has the requests themselves (EventLog).
  std::uint32_t settings_number = 0, arming_number = 0;
  std::uint8_t method = 0;                                 ///< ForceMethod
  std::uint8_t switches = 0;                               ///< TickSwitch bits
  double max_force_N = 0;                                  ///< the user's limit
  std::array<double, 4> rotation_target_wxyz{1, 0, 0, 0};  ///< commanded object rotation
  std::array<double, 4> rotation_felt_wxyz{1, 0, 0, 0};    ///< interpolated, the one that is felt
  int devices = 1;
  std::uint64_t state_hash = 0;  ///< of the session state after the tick, what was sent included
  std::array<DeviceTick, kMaxDevices>
      device{};  ///< last, so that a copy may leave out those that there are not
};

}  // namespace palpate
