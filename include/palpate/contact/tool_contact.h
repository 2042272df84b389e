#pragma once

#include <array>
#include <limits>
#include <span>

#include "palpate/base/force_method.h"
#include "palpate/contact/contact_site.h"
#include "palpate/contact/model.h"
#include "palpate/contact/neighbour_tools.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/velocity.h"
#include "palpate/device/device.h"
#include "palpate/device/device_parameters.h"
#include "palpate/device/telemetry.h"

/// Contact of a device's tool with the model, and how the proxy computes it. For the direct force methods see
/// palpate/direct/direct_methods.h.
namespace palpate {

/// Tick inputs common to all devices.
struct TickContext {
  const Model& model;
  ForceMethod method = ForceMethod::kTrilinear;
  bool friction = true, viscosity = true;  ///< Whether friction and viscosity are rendered
  double dt_s = 0.001;                     ///< Length of the tick
  /// Pose of the patient in the world, including the object's rotation.
  Transform<World, Patient> X_WorldPatient;
  Transform<Patient, World> X_PatientWorld;
  /// Local compliance of deformable tissue; null: no solution yet
  const ComplianceFrame* compliance = nullptr;
  Holes* holes = nullptr;                               ///< As ProxyOptions::holes
  std::span<const TissueContact> tissue_contacts = {};  ///< As ProxyOptions::tissue_contacts
};

/// Tick inputs of one device.
struct DeviceContext {
  const Tool& tool;
  const DeviceParameters& device;
  Eigen::Matrix3d R_WorldTool;    ///< Rotation from tool axes to world axes
  Point<Patient> tip;             ///< Position of the tool's origin
  Vector<Patient> velocity_mm_s;  ///< Velocity of the tip relative to the object
  std::size_t device_index = 0;   ///< Index of the device

  /// Transforms a vector from tool axes to patient axes.
  /// @param of_tool  vector in the tool's frame
  Vector<Patient> in_patient(const TickContext& tick, const Eigen::Vector3d& of_tool) const {
    return tick.X_PatientWorld * Vector<World>(R_WorldTool * of_tool);
  }
  /// Maximum rendered stiffness in the patient, from the device's limit and gains; N/mm, at least 0.
  double max_stiffness_N_per_mm() const;
  /// Maximum total damping in the patient; N s/mm. Infinite if the device has no limit.
  double max_damping_N_s_per_mm() const;
};

/// Upper limit of the stiffness rendered for deformable tissue, N/mm in the patient: the stiffness of the
/// stiffest touchable tissue if that tissue is rigid, so that deformable tissue is never stiffer than bone.
/// Infinite if that tissue is deformable, or under a law without deformable tissue.
double max_deformable_stiffness_N_per_mm(const Model& model);

/// Contact of one point of the tool.
struct PointContact {
  /// Value and gradient of the force field; with the proxy, the gradient is the inward contact normal.
  FieldSample sample;
  /// Structure in contact.
  ContactSite site;
  Vector<Patient> force_N;  ///< Force on the tool, friction and viscosity included
  Point<Patient> proxy;     ///< Proxy of the tool's origin; with a direct method, the tool's origin itself
  bool presses = false;     ///< Proxy method only: whether the tip is below the surface and the contact force
                            ///< is not zero

  /// Whether the point counts as in contact. With the proxy: `presses`, for any force, because the force of
  /// soft tissue is imperceptible at small depths. With a direct method, or inside a punctured structure:
  /// whether the force is perceptible, or the point is so deep inside a structure that the field gradient
  /// vanishes.
  bool is_contact() const;
};

/// Contact of a part of the tool with a structure.
struct ContactPoint {
  LabelId label = 0;  ///< Structure in contact. 0: unused entry
  int part = 0;       ///< Index of the tool part: its points, then its capsules
  /// Contact point on the surface; for a direct method the position of the tool point
  Point<Patient> position;
  double force_N = 0;  ///< Magnitude of the force along the surface normal, in the patient
};

/// Structure along the penetration path.
struct PathStructure {
  LabelId label = 0;
  double depth_mm = 0;  ///< Length of the path within the structure; NaN: beyond the range of the distance
                        ///< field
  double fraction = 0;  ///< Fraction of the force, 0 ... 1
};

/// Contact of the whole tool: requested force with the device's gains applied, and its contacts.
struct ToolContact {
  /// Force and torque about the tool's origin requested at the device, in world axes.
  Wrench requested;
  PointContact strongest;  ///< Strongest contact of the outermost layer
  /// Contacts, outermost layer first, within a layer by decreasing force. Unused entries have label 0.
  /// Contacts beyond the capacity are dropped.
  std::array<ContactPoint, kMaxContactsReported> contacts;
  /// Structures along the penetration path, outermost first. Unused entries have label 0.
  std::array<PathStructure, kMaxStructuresReported> path;
  /// Elastic energy of the contact at the device, an upper bound of what it can return; infinite: unknown.
  double stored_mJ = std::numeric_limits<double>::infinity();
  double stiffness_N_per_mm = 0;  ///< Maximum contact stiffness at the device
  std::uint32_t flags = 0;  ///< Flags of the proxy: kFlagInside, kFlagWedged, kFlagRuptured, kFlagRelease
  TissueContact tissue_contact;  ///< Contact with deformable tissue; unset if there is none
  /// Work that the other tools have done on `tissue_contact` in this tick, scaled to the device; negative:
  /// energy taken from it.
  double received_mJ = 0;
  /// Whether the proxy was uncoupled because restored tissue covers it; its force is blended out.
  bool released = false;
};

/// The tool's spheres and capsules in the operator's pose, in the patient frame.
class PosedTool {
 public:
  PosedTool(const TickContext& tick, const DeviceContext& context);
  const ToolPose& pose() const { return pose_; }
  std::span<const ToolPart> parts() const { return {parts_.data(), count_}; }
  /// Replaces the first part, which is the head of a burr.
  void set_first(const ToolPart& part) { parts_[0] = part; }

 private:
  std::array<ToolPart, kMaxToolParts> parts_;
  std::size_t count_ = 0;
  ToolPose pose_;
};

/// State of the spring and damper between tip and proxy.
struct CouplingState {
  double stiffness_N_per_mm = 0;  ///< Filtered rendered stiffness. 0: no contact
  /// Spring vector: from the tip to the proxy, times ProxyLayer::stretch_fraction.
  Vector<Patient> spring_mm;
  /// Velocity of spring_mm, including free space; unused without damping
  VelocityWindow spring_velocity;
};

/// Options of advance_proxy() for a device in this tick.
ProxyOptions proxy_options(const TickContext& tick, const DeviceContext& context);

/// Force and contacts of a proxy that has been advanced. Friction is computed by the proxy; viscosity is
/// viscous_force(), as for the direct methods.
/// @param posed_tool  tool with which the proxy was advanced
/// @param proxy       state after the advance
/// @param result      result of the advance
/// @param coupling    spring and damper, updated
ToolContact touch_by_proxy(const TickContext& tick, const DeviceContext& context, const PosedTool& posed_tool,
                           ProxyState& proxy, const ProxyResult& result, CouplingState& coupling);

}  // namespace palpate
