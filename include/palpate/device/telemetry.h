#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <string>
#include <vector>

#include "palpate/device/session_settings.h"

/// Inputs and outputs of one tick as plain numbers, for the recorder and the viewers. Units are in the names.
/// Frames: names with `world`, orientations, forces and torques are in World, all others in Patient.
namespace palpate {

/// Maximum number of devices in a tick.
inline constexpr int kMaxDevices = 4;
/// Maximum number of structures along the tip's path that a tick reports.
inline constexpr int kMaxStructuresReported = 6;
/// Maximum number of contacts that a tick reports.
inline constexpr int kMaxContactsReported = 6;
/// Maximum number of structures near the tool that a tick reports.
inline constexpr std::size_t kMaxNearReported = 8;

/// Value of unknown quantities: not a number.
inline constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();

/// Conditions of a tick: contact, and why its output was changed or withheld. Bits.
enum TickFlag : std::uint32_t {
  kFlagClamped = 1u << 0,    ///< The force exceeded the limit: lower the stiffness or press less
  kFlagNotFinite = 1u << 1,  ///< State, force or duration NaN, infinite or below 0 s; the output was zero
  kFlagOutside = 1u << 2,    ///< The tip is outside the volume, in free space
  kFlagPaused = 1u << 3,     ///< Paused or about to stop: the force fades out and stays off
  kFlagContact = 1u << 4,    ///< A structure is in contact
  /// The commanded rotation was not a unit quaternion; the previous one stays in effect
  kFlagRotationIgnored = 1u << 5,
  kFlagThermal = 1u << 6,  ///< The limit was below the peak force to protect the motors from heat
  kFlagSlew = 1u << 7,     ///< The force changed at the slew limit towards its requested value
  kFlagRamp = 1u << 8,     ///< The force was ramping in (over 0.5 s) or out
  kFlagStale = 1u << 9,    ///< The state was older than 5 ms: the force decays, and is zero from 10 ms
  kFlagJump = 1u << 10,    ///< The tip moved farther in one tick than an operator can; the output was zero
  kFlagDeviceFault = 1u << 11,    ///< The device withholds forces by itself; the output was zero
  kFlagHalted = 1u << 12,         ///< The watchdog had halted the device; the output was zero
  kFlagEmergencyStop = 1u << 13,  ///< Emergency stop; the output was zero
  kFlagClutched = 1u << 14,       ///< The clutch was held: the force fades out and stays off
  kFlagBlend = 1u << 15,          ///< Blending from the force of the previous method, model or parameters
  kFlagMethodMissing = 1u << 16,  ///< The model is not prepared for the method; the trilinear one was used
  kFlagInside = 1u << 17,         ///< The proxy waits: the tip has been inside since contact was reset
  kFlagWedged = 1u << 18,         ///< The tool is wider than the gap that it is in; the proxy stayed in place
  kFlagRuptured = 1u << 19,       ///< The tool punctured a surface
  kFlagPassivity = 1u << 20,      ///< The passivity controller reduced the force
  kFlagRotationLimited = 1u << 21,  ///< The object rotated slower than commanded, to limit the work on the
                                    ///< operator
  kFlagNoGo = 1u << 22,             ///< The tool is closer to a no-go region than its keep_away distance
  kFlagRelease = 1u << 23,          ///< The tool left the layer around a structure, whose force fades out
  /// A cutting burr broke through: set from that tick on for kBurrRenderingSettings.break_through_s
  kFlagBreakThrough = 1u << 24,
};
/// Faults: they set the force to zero at once; it returns by the ramp.
inline constexpr std::uint32_t kFaultFlags =
    kFlagNotFinite | kFlagJump | kFlagDeviceFault | kFlagHalted | kFlagEmergencyStop;

/// Inputs and outputs of a tick that belong to one device.
struct DeviceTick {
  // inputs
  std::array<double, 3> tip_world_mm{};
  std::array<double, 4> orientation_wxyz{1, 0, 0, 0};
  std::array<double, 3> velocity_world_mm_s{kNoValue, kNoValue, kNoValue};  ///< Estimated by the device
  /// Estimated by the device
  std::array<double, 3> angular_velocity_world_rad_s{kNoValue, kNoValue, kNoValue};
  double gripper_rad = kNoValue;
  std::uint32_t buttons = 0;
  std::uint32_t status = 0;  ///< DeviceStatus bits
  double age_s = 0;          ///< Age of the pose
  // inputs: DeviceParameters; NaN: unknown
  double force_gain = 1, scale = 1;
  double peak_force_N = kNoValue, continuous_force_N = kNoValue, peak_torque_Nmm = kNoValue;
  double peak_gripper_N = kNoValue, slew_N_per_s = kNoValue;
  double max_stiffness_N_per_mm = kNoValue, position_step_mm = kNoValue;
  double max_damping_N_s_per_mm = kNoValue;  ///< NaN: unknown
  double delay_s = 0;
  // outputs
  std::array<double, 3> force_N{};     ///< Force sent, World
  std::array<double, 3> torque_Nmm{};  ///< Torque sent, about the tip, World
  double gripper_N = 0;                ///< Gripper force sent
  double unclamped_force_N = 0;        ///< Magnitude before the output stage
  double limit_N = 0;            ///< Least of the device's, user's, scene's and thermal limit in this tick
  double heat = 0;               ///< Fraction of the thermal budget in use, 0 ... 1
  double energy_mJ = 0;          ///< Energy put in by the operator minus energy returned (passivity observer)
  double damping_N_s_per_m = 0;  ///< Damping along the force, added by the passivity controller
  double turned_mJ = 0;          ///< Work that the object's rotation has done on the operator since the start
                                 ///< of the run
  double cutting_N = 0;          ///< Press force of a burr while it cuts, in the patient; 0: not cutting
  /// Mean specific cutting energy of the material ahead of a burr while it cuts; 0: not cutting
  double cutting_energy_mJ_per_mm3 = 0;
  double vibration_hz = 0;  ///< Frequency of a burr's rendered vibration; 0: none is rendered
  double vibration_N = 0;   ///< Amplitude of that vibration
  double kick_N = 0;        ///< Force of a burr's kick along the direction in which it would roll; signed
  double bone_rise_K = 0;   ///< Estimated temperature rise of the bone at a burr without irrigation
  std::array<double, 3> tip_patient_mm{};
  /// Position of the proxy in the outermost layer; for a burr, in the layer in which it cuts, which is the
  /// position of its head. With a direct method, the tip.
  std::array<double, 3> proxy_patient_mm{};
  /// Outward unit normal of all contacts together; zero in free space
  std::array<double, 3> normal_patient{};
  /// Windowed mean velocity of the tip relative to the object
  std::array<double, 3> velocity_patient_mm_s{};
  double field = 0;  ///< Field value at the tip, 0 ... 1; 0 with the proxy, which does not sample a field
  /// ContactSite::depth_mm: NaN if no surface is within reach, 0 without contact. With the proxy, distance
  /// from the proxy to the tip.
  double depth_mm = 0;
  std::uint16_t label = 0;  ///< Touched structure; 0: none
  /// Contacts of the tool: structure, part of the tool (its points, then its capsules), position on the
  /// surface, and force along the normal, in the patient. The outermost layer's come first, within a layer
  /// the strongest first; the first one belongs to `label`. Label 0 ends the list.
  std::array<std::uint16_t, kMaxContactsReported> contact_label{}, contact_part{};
  /// Origin of the force: structures along the tip's path into the tissue, outermost first, the length of the
  /// path within each, and each one's share of the force, 0 ... 1. With a direct method, the touched
  /// structure with share 1. Label 0 ends the list; empty without contact.
  std::array<std::uint16_t, kMaxStructuresReported> path_label{};
  /// Structures near the tool, nearest first (nearest_structures). Label 0 ends the list.
  std::array<std::uint16_t, kMaxNearReported> near_label{};
  /// No-go region that the tool is deepest in (NoGoForce): index in the scene from 1; 0: none.
  std::uint16_t no_go = 0;
  std::array<double, 3 * kMaxContactsReported> contact_patient_mm{};
  std::array<double, kMaxContactsReported> contact_N{};
  std::array<double, kMaxStructuresReported> path_depth_mm{}, path_share{};
  /// Distance from the tool's outline to each structure of near_label, negative inside.
  std::array<double, kMaxNearReported> near_mm{};
  /// Depth of the tool inside the keep-away zone of no_go, and the force of all no-go regions together at the
  /// device, in addition to the contacts' and before the output stage.
  double no_go_depth_mm = 0, no_go_N = 0;
  std::uint32_t flags = 0;  ///< TickFlag bits
};

/// Inputs and outputs of one tick.
struct TickRecord {
  std::uint64_t tick = 0;
  double time_s = 0;  ///< 0 in the first tick, then the sum of dt_s of all earlier ticks
  double dt_s = 0;
  double lateness_s = 0;  ///< Real clock: delay of the tick's start; not part of the hash
  double compute_s = 0;   ///< Real clock: time from reading the states to the commands; not part of the hash
  std::uint32_t model_version = 0;
  std::uint32_t solver_frame = 0;  ///< Deformable tissue: newest solution (ComplianceFrame); 0: none yet
  /// Number of parameter changes, and of stops and rearms, that the loop had taken into account. Not
  /// recorded: recordings contain the requests themselves (EventLog).
  std::uint32_t settings_number = 0, arming_number = 0;
  std::uint8_t method = 0;                                  ///< ForceMethod
  std::uint8_t switches = 0;                                ///< TickSwitch bits
  double max_force_N = 0;                                   ///< The user's limit
  std::array<double, 4> rotation_target_wxyz{1, 0, 0, 0};   ///< Commanded rotation of the object
  std::array<double, 4> rotation_applied_wxyz{1, 0, 0, 0};  ///< Interpolated rotation of the object in effect
  int devices = 1;
  std::uint64_t state_hash = 0;  ///< Hash of the session state after the tick, including what was sent
  std::array<DeviceTick, kMaxDevices> device{};  ///< Last member, so that copies can omit the unused entries
};

}  // namespace palpate
