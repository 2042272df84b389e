#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "palpate/device/device.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"
#include "palpate/haptics/acting_force.h"
#include "palpate/haptics/haptics.h"
#include "palpate/haptics/passivity.h"
#include "palpate/haptics/swing.h"
#include "palpate/haptics/tool_contact.h"
#include "palpate/servo/feel.h"
#include "palpate/tissue/removal.h"

/// The tick: (Model, SessionState, DeviceStates, Parameters, dt) -> (SessionState, Wrenches).
namespace palpate {

/// Inputs of a tick that may change while the loop runs. A change of method, switch or gain is felt as a
/// blend over kOutputFeel.blend_s, not as a step.
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
  /// Of tissue that yields, what was solved last. Another one is blended in by the contact itself.
  YieldFrame yields;
};

/// TickSwitch bits.
std::uint8_t switches_of(const Parameters& parameters);

/// What the output stage remembers of one device.
struct OutputState {
  Wrench sent;
  double gain = 0;         ///< of the ramp, 0 ... 1
  double heat = 0;         ///< part of the thermal budget that is used, 0 ... 1
  double whole_s = 0;      ///< since the last fault or dropout; not counted beyond the ramp's time
  bool away = false;       ///< no fresh pose now, for a short time yet: the gain waits
  bool returning = false;  ///< one has come again: the force grows slowly for a while
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
    double blend_elapsed_s = kOutputFeel.blend_s;
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
  Holes holes;  // that stayed open where tools went through
  // of the last frame that was told while nothing yielded: it says nothing of tissue that begins to
  std::uint32_t last_unfelt_frame = 0;
  std::array<Hand, kMaxDevices> hands;
  /// Those of the model of the last tick, by which a new version's are told from other ones. They follow from
  /// that version, which the hash knows.
  struct Surfaces {
    std::uint32_t version = 0;  ///< of that model, 0 before the first tick
    std::uint32_t edits = 0;    ///< likewise
    int count = 0;
    bool yield = false;  ///< is_elastic(Model::tissue_law): by another one structures lie in other layers
    std::array<LabelId, kMostSurfaces> label{};
    std::array<std::uint64_t, kMostSurfaces> content{};  ///< Surface::content_hash()
  } surfaces;

  /// 64-bit hash of the state, equal for equal states on every build.
  std::uint64_t hash(int devices) const;
};

/// One servo tick. Allocates, locks, logs, throws nothing and makes no system call.
/// @param devices  1 ... kMaxDevices states; `wrenches` has the same length
/// @param record   filled with what the tick took in and gave out
void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record);

}  // namespace palpate
