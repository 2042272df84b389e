#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "palpate/contact/acting_force.h"
#include "palpate/contact/model.h"
#include "palpate/contact/neighbour_tools.h"
#include "palpate/contact/oscillation.h"
#include "palpate/contact/passivity.h"
#include "palpate/contact/tool_contact.h"
#include "palpate/contact/velocity.h"
#include "palpate/device/device.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/session_settings.h"
#include "palpate/device/telemetry.h"
#include "palpate/device/workspace.h"
#include "palpate/servo/burr_rendering.h"
#include "palpate/servo/servo_settings.h"
#include "palpate/tissue/removal.h"

/// The tick: (Model, SessionState, DeviceStates, Parameters, dt) -> (SessionState, Wrenches).
namespace palpate {

/// Inputs of a tick that may change while the loop runs. A change of method, gain or blended switch is
/// blended in over kOutputSettings.blend_s instead of applied as a step.
struct Parameters : Settings {
  bool emergency_stop = false;  ///< Set the forces to zero at once
  std::array<DeviceParameters, kMaxDevices> device;
  /// Latest solution of deformable tissue. A new solution is blended in by the contact law
  /// (blend_compliance()).
  ComplianceFrame compliance;
};

/// TickSwitch bits of the parameters.
std::uint8_t switches_of(const Parameters& parameters);

/// State of the output stage for one device.
struct OutputState {
  Wrench sent;
  double gain = 0;           ///< Ramp gain, 0 ... 1
  double heat = 0;           ///< Fraction of the thermal budget in use, 0 ... 1
  double since_fault_s = 0;  ///< Time since the last fault or dropout; saturates at ramp_in_s
  /// In a dropout that still counts as short; the ramp gain is not reset
  bool in_dropout = false;
  bool returning = false;  ///< Recovering from a short dropout: the force grows at return_N_per_s at most
};

/// Complete state of the tick function. Small, copyable, hashable; contains no pointers.
struct SessionState {
  struct DeviceSession {
    bool has_previous = false;  ///< A previous tip position exists
    Point<World> previous_world;
    Point<Patient> previous_tip;
    VelocityWindow velocity;
    ProxyState proxy;
    std::uint32_t proxy_version = 0;       ///< Version of the model whose surfaces the proxy is on
    bool pushed_by_direct_method = false;  ///< A direct method pushed the tip in the previous tick
    CouplingState coupling;
    /// Contact with deformable tissue in the last tick; unset with a single device.
    TissueContact tissue_contact;
    BurrState burr;  ///< Default-constructed unless the tool is a burr
    BurrRenderingState burr_rendering;
    // last requested wrench after blending, and its initial difference to the wrench of the previous force
    // source, which fades out
    Wrench requested;
    Wrench difference;
    double blend_elapsed_s = kOutputSettings.blend_s;
    PassivityState passivity;
    OscillationState oscillation;
    DelayLine delay;
    double turned_mJ = 0;  ///< Work that the object's rotation has done on the operator since the start of
                           ///< the run
    OutputState output;

    /// Resets the contact. For use when it is unknown on which side of each surface the tip lies.
    void reset_contact();
    /// Resets all state that is derived from the path of the tip, for use after the path was interrupted. The
    /// output stage and the burr's sweeps are retained.
    void reset_path();
  };

  std::uint64_t tick = 0;
  double time_s = 0;
  // rotation of the object, interpolated over kRotationSettings.interval_s from each command
  Eigen::Quaterniond rotation_start = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_target = Eigen::Quaterniond::Identity();
  Eigen::Quaterniond rotation_applied = Eigen::Quaterniond::Identity();
  double rotation_elapsed_s = 1.0;
  // digest of everything that selects the force computation; 0 before the first tick. A new value starts a
  // blend
  std::uint64_t force_source = 0;
  // cutting tools: number of strokes, each of which begins when a motor starts while all are off, and whether
  // any motor is on
  std::uint32_t strokes = 0;
  bool motor_on = false;
  Holes holes;  // holes left open by punctures
  // number of the last solution received while no tissue was deformable; it and older ones are ignored after
  // tissue becomes deformable
  std::uint32_t last_ignored_solver_frame = 0;
  std::array<DeviceSession, kMaxDevices> device;
  /// Surfaces of the last tick's model, used to match those of a new version. Derived from that version,
  /// which the hash includes.
  struct Surfaces {
    std::uint32_t version = 0;  ///< Version of that model; 0 before the first tick
    std::uint32_t edits = 0;    ///< Model::edits of that model
    int count = 0;
    /// is_elastic(Model::tissue_law); a change assigns structures to other layers
    bool is_deformable = false;
    std::array<LabelId, kMaxSurfaces> label{};
    std::array<std::uint64_t, kMaxSurfaces> content{};  ///< Surface::content_hash()
  } surfaces;

  /// 64-bit hash of the state; equal states have equal hashes in every build.
  std::uint64_t hash(int devices) const;
};

/// One servo tick. Does not allocate, lock, log or throw, and makes no system call.
///
/// The tick is refused if `dt_s` is negative or not finite, the number of devices is not 1 ... kMaxDevices,
/// `wrenches` has a different length, or the model is prepared neither for the proxy nor for the trilinear
/// method. Then all wrenches are zero, the state is unchanged, and every device has kFlagNotFinite.
/// @param devices   1 ... kMaxDevices states; `wrenches` has the same length
/// @param dt_s      duration since the last tick; finite, at least 0
/// @param wrenches  receives the wrench to send to each device
/// @param record    receives the inputs and outputs of the tick
void tick(const Model& model, const Parameters& parameters, std::span<const DeviceState> devices, double dt_s,
          SessionState& state, std::span<Wrench> wrenches, TickRecord& record);

}  // namespace palpate
