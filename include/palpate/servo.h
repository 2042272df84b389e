#pragma once

#include <array>
#include <cstdint>
#include <span>

#include "palpate/device.h"
#include "palpate/haptics.h"
#include "palpate/telemetry.h"

/// The tick: (Model, SessionState, DeviceStates, Parameters, dt) -> (SessionState, Wrenches).
namespace palpate {

enum class ForceMethod : std::uint8_t {
  kTrilinear = 0,  ///< trilinear interpolation + central differences
};

/// Inputs of a tick that may change while the loop runs.
struct Parameters {
  ForceMethod method = ForceMethod::kTrilinear;
  bool friction = true;
  bool viscosity = true;
  bool paused = false;
  double max_force_N = 3.0;  ///< the least of device, user and scene limit
  /// Rotation of the object about World's origin; commanded about 10 times a second.
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
};

/// Everything a tick remembers. Small, copyable, hashable; no pointers.
struct SessionState {
  struct Hand {
    bool seen = false;  ///< a previous tip exists
    Point<Patient> previous_tip;
    VelocityWindow velocity;
  };
  std::uint64_t tick = 0;
  double time_s = 0;
  // object rotation, interpolated over kRotationInterval from each command
  Eigen::Quaterniond rotation_start = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_felt = Eigen::Quaterniond::Identity();
  double rotation_elapsed_s = 1.0;
  std::array<Hand, kMaxDevices> hands;

  /// 64-bit hash of the state, equal for equal states on every build.
  std::uint64_t hash(int devices) const;
};
inline constexpr double kRotationInterval_s = 0.1;

/// One servo tick. Allocates, locks, logs and throws nothing.
/// @param devices  1 ... kMaxDevices states; `wrenches` has the same length
/// @param record   filled with what the tick took in and gave out
void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record);

}  // namespace palpate
