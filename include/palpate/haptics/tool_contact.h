#pragma once

#include <array>
#include <limits>
#include <span>

#include "palpate/base/force_method.h"
#include "palpate/device/device.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/telemetry.h"
#include "palpate/haptics/haptics.h"
#include "palpate/haptics/proxy.h"

/// A tool in a hand meets the model: by a direct method, or by the proxy.
namespace palpate {

/// What all devices of a tick share.
struct TickContext {
  const Model& model;
  ForceMethod method = ForceMethod::kTrilinear;
  bool friction = true, viscosity = true;
  double dt_s = 0.001;
  Transform<World, Patient> X_WorldPatient;  ///< with the object's rotation
  Transform<Patient, World> X_PatientWorld;
  const YieldFrame* yields = nullptr;  ///< of tissue that yields; null: nothing is known of it
  Holes* holes = nullptr;              ///< ProxyOptions::holes
};

/// What belongs to one device in a tick.
struct HandContext {
  const Tool& tool;
  const DeviceParameters& device;
  Eigen::Matrix3d R_WorldTool;
  Point<Patient> tip;             ///< the tool's origin
  Vector<Patient> velocity_mm_s;  ///< of the tip, relative to the object
  std::size_t number = 0;         ///< of the device

  /// What is fixed to the tool, as the hand holds it now, in the patient.
  Vector<Patient> in_patient(const TickContext& tick, const Eigen::Vector3d& of_tool) const {
    return tick.X_PatientWorld * Vector<World>(R_WorldTool * of_tool);
  }
  /// N/mm in the patient that are felt at most, with the device's gains; at least 0.
  double most_stiffness_N_per_mm() const;
  /// Likewise, of all that damps, N s/mm; infinite where nothing is known of it.
  double most_damping_N_s_per_mm() const;
};

/// What one point of the tool meets.
struct PointContact {
  FieldSample sample;
  ContactSite site;
  Vector<Patient> force_N;  ///< surface effects included
  Point<Patient> proxy;     ///< of the tool's origin

  /// Felt, or so deep inside that there is no direction to push in.
  bool is_touch() const;
};

/// Where a part of the tool leans on a structure.
struct ContactPoint {
  LabelId label = 0;     ///< 0: none
  int part = 0;          ///< of the tool: its points, then its capsules
  Point<Patient> place;  ///< on the surface; by a direct method, of the point that is inside
  double force_N = 0;    ///< along the surface's normal, in the patient
};

/// A structure along the tip's way in.
struct FeltStructure {
  LabelId label = 0;
  double depth_mm = 0;  ///< of the way that lies within it; NaN: deeper than is measured
  double share = 0;     ///< of the force, 0 ... 1
};

/// What all of the tool asks for together, multiplied by the device's gains, and what it leans on.
struct ToolContact {
  Wrench asked;
  PointContact strongest;  ///< of the outermost layer
  /// Those of the outermost layer first, in each the strongest first; those after the last have label 0. Of
  /// more than there is room for, these.
  std::array<ContactPoint, kMostContactsTold> contacts;
  /// Outermost first; those after the last have label 0.
  std::array<FeltStructure, kMostTold> felt;
  /// Energy at the device that the contact can hold as a spring does; infinite: not known.
  double stored_mJ = std::numeric_limits<double>::infinity();
  double stiffness_N_per_mm = 0;  ///< of it, at the device, where it is stiffest
  std::uint32_t flags = 0;        ///< of the proxy: kFlagInside, kFlagWedged, kFlagRuptured
  /// The proxy was let go, because what was put back is where it was: the force that it gave fades out.
  bool let_go = false;
};

ToolContact touch_directly(const TickContext& tick, const HandContext& hand);

/// The tool's spheres and capsules as the hand holds it now, in the patient.
class HeldTool {
 public:
  HeldTool(const TickContext& tick, const HandContext& hand);
  const ToolPose& pose() const { return pose_; }
  std::span<const ToolSphere> spheres() const { return {spheres_.data(), count_}; }
  /// In place of the first sphere, which a burr is.
  void set_first(const ToolSphere& sphere) { spheres_[0] = sphere; }

 private:
  std::array<ToolSphere, kMostToolSpheres> spheres_;
  std::size_t count_ = 0;
  ToolPose pose_;
};

/// What the spring and the damper between tip and proxy remember.
struct CouplingState {
  double stiffness_N_per_mm = 0;  ///< that is felt; 0: without contact
  Vector<Patient> pull_mm;        ///< from the tip to the proxy
  VelocityWindow pull_velocity;   ///< of its change, free space included; empty without damping
};

/// With what a proxy is advanced for a hand.
ProxyOptions proxy_options(const TickContext& tick, const HandContext& hand);

/// What an advanced proxy gives the hand. Friction is the proxy's own, viscosity that of the direct methods.
/// @param held   as the proxy was advanced with
/// @param proxy  as it is now
ToolContact touch_by_proxy(const TickContext& tick, const HandContext& hand, const HeldTool& held,
                           ProxyState& proxy, const ProxyResult& result, CouplingState& coupling);

}  // namespace palpate
