#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

/// What one tick took in and gave out, as plain numbers: what the recorder writes, what viewers show.
/// Units are in the names; frames: tip_world and force in World, the rest in Patient.
namespace palpate {

/// Reasons why a tick's output was changed or withheld. Bits.
enum TickFlag : std::uint32_t {
  kFlagClamped = 1u << 0,          ///< the force was larger than the limit: lower stiffness or press less
  kFlagNotFinite = 1u << 1,        ///< a state or force was NaN or infinite; the output was zero
  kFlagOutside = 1u << 2,          ///< the tip is outside the volume: free space
  kFlagPaused = 1u << 3,           ///< force off while paused
  kFlagContact = 1u << 4,          ///< a felt structure is touched
  kFlagRotationIgnored = 1u << 5,  ///< the commanded rotation was no unit quaternion: the last one holds
};

/// TickRecord::switches. Bits.
enum TickSwitch : std::uint8_t {
  kSwitchFriction = 1u << 0,
  kSwitchViscosity = 1u << 1,
  kSwitchPaused = 1u << 2,
};

struct DeviceTick {
  // in
  std::array<double, 3> tip_world_mm{};
  std::array<double, 4> orientation_wxyz{1, 0, 0, 0};
  std::uint32_t buttons = 0;
  // out
  std::array<double, 3> force_N{};     ///< sent, World
  std::array<double, 3> torque_Nmm{};  ///< about the tip, World
  double unclamped_force_N = 0;        ///< magnitude before the safety stage
  std::array<double, 3> tip_patient_mm{};
  std::array<double, 3> normal_patient{};         ///< outward, unit; zero in free space
  std::array<double, 3> velocity_patient_mm_s{};  ///< windowed, relative to the object
  double field = 0;                               ///< 0 ... 1
  double depth_mm = 0;      ///< ContactSite::depth_mm; NaN: no surface within reach, 0 where nothing is felt
  std::uint16_t label = 0;  ///< touched structure, 0 none
  std::uint32_t flags = 0;  ///< TickFlag bits
};

struct TickRecord {
  std::uint64_t tick = 0;
  double time_s = 0;  ///< virtual or real clock at the start of the tick
  double dt_s = 0;
  std::uint32_t model_version = 0;
  std::uint8_t method = 0;                                 ///< ForceMethod
  std::uint8_t switches = 0;                               ///< TickSwitch bits
  double max_force_N = 0;                                  ///< limit in force during this tick
  std::array<double, 4> rotation_target_wxyz{1, 0, 0, 0};  ///< commanded object rotation
  std::array<double, 4> rotation_felt_wxyz{1, 0, 0, 0};    ///< interpolated, the one that is felt
  int devices = 1;
  std::array<DeviceTick, 4> device{};
  std::uint64_t state_hash = 0;  ///< of the session state and the outputs after the tick
};

}  // namespace palpate
