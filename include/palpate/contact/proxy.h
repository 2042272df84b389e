#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <span>

#include "palpate/contact/contact_settings.h"
#include "palpate/contact/contact_surface.h"
#include "palpate/contact/holes.h"
#include "palpate/contact/neighbour_tools.h"
#include "palpate/contact/proxy_state.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/contact/tool_shape.h"

/// God-object / proxy contact. A proxy of the tool tip is constrained to stay outside the surfaces while the
/// device's tip penetrates them, and a virtual spring from the tip to the proxy generates the force (Zilles &
/// Salisbury 1995; on implicit surfaces Salisbury & Tarr 1997). Positions are in the patient frame, so a
/// proxy that sticks by friction moves along with a rotating object.
namespace palpate {

/// Parameters of advance_proxy.
struct ProxyOptions {
  bool friction = true;  ///< Whether friction is rendered
  /// Upper limit of the rendered stiffness: the largest at which the device is stable in an operator's hand.
  double max_stiffness_N_per_mm = std::numeric_limits<double>::infinity();
  double dt_s = 0.001;  ///< Time since the last call
  /// Limit of the rate at which the force on the tip changes while the proxy slips.
  double max_slip_N_per_s = kProxySettings.max_slip_N_per_s;
  /// Local compliance of deformable structures, published by the elastic solver; `device` selects the entry
  /// of this tool. null: no solution yet, each structure is an elastic half-space.
  const ComplianceFrame* compliance = nullptr;
  std::size_t device = 0;
  /// Contacts of all devices with deformable tissue in the last tick. Empty: there is one device.
  std::span<const TissueContact> tissue_contacts = {};
  /// Relaxation times of the model. null: nothing relaxes.
  const RelaxationTimes* relaxation_times = nullptr;
  /// Permanent holes of all tools in structures with stays_open. null: every puncture closes.
  Holes* holes = nullptr;
  /// Maximum fraction of a substep by which the distance to the tip may increase.
  double max_distance_increase = kProxySettings.max_distance_increase;
  /// Upper bound of the residual force of released layers: the device's peak force, converted to the patient.
  double max_force_N = std::numeric_limits<double>::infinity();
};

/// Force of the springs from the tip to the proxies.
struct ProxyForce {
  Vector<Patient> force_N;     ///< Force on the tip
  Vector<Patient> torque_Nmm;  ///< Torque about the tip, with lever arms in the proxy's attitude
  /// Secant stiffness (force over depth): mean over the contacts, weighted by multiplier and ownership share,
  /// summed over the layers.
  double stiffness_N_per_mm = 0;
  /// Tangent stiffness (derivative of the force by depth). Differs from the secant for deformable structures.
  double tangent_N_per_mm = 0;
  double stored_mJ = 0;     ///< Elastic energy
  bool deformable = false;  ///< Whether a deformable structure is in contact
};

/// Contribution of one structure along the penetration path. The force is the stiffness integrated along the
/// path, so each structure contributes its stiffness times the length of the path within it.
struct PathSegment {
  int structure = -1;  ///< Index into the surfaces
  /// Path length within the structure. Where structures share a surface, the length is divided by ownership
  /// share, so that the depths sum to the path length.
  double depth_mm = 0;
  double fraction = 0;  ///< Fraction of the force, 0 ... 1
};
inline constexpr std::size_t kMaxPathSegments = 6;  ///< Capacity of ProxyResult::path

/// Total over all layers, including the force still being released.
struct ProxyResult : ProxyForce {
  std::array<ProxyForce, kMaxLayers> of_layer;  ///< Contribution of each layer
  ResidualForce release;                        ///< Residual force included in the total; it has no contacts
  /// Structures along the penetration path, outermost first; empty without contact. If more than
  /// kMaxPathSegments structures contribute, the ones with the largest fractions.
  std::array<PathSegment, kMaxPathSegments> path;
  int path_segments = 0;  ///< Number of valid entries of `path`
  /// Mean friction coefficient of the contacts: static if sticking, otherwise kinetic. 0 if friction is
  /// disabled.
  double friction = 0;
  /// Force-weighted mean of the contact normals of all layers; unit. 0 without contact.
  Vector<Patient> normal;
  /// Whether the half-spaces have no common point, i.e. the tool is wider than the gap around it. The proxy
  /// then keeps its position or, if the rotation is infeasible, its attitude. A proxy that starts inside
  /// surfaces after a tool change gives no force until the tip is in free space.
  bool wedged = false;
  bool ruptured = false;         ///< Whether a structure was punctured in this tick
  TissueContact tissue_contact;  ///< Contact with deformable tissue; unset if there is none
  /// Whether the proxy has not reached its goal: the tool moved or turned farther than the work limit of one
  /// tick allows, or the proxy slips. It continues in the next tick. Contacts cannot be punctured meanwhile.
  bool lagging = false;
};

/// Advances the proxies by one tick: rotates each proxy from its attitude to the operator's, moves it towards
/// the tip along the surfaces without passing through them, then evaluates the springs. The whole path is
/// collision-checked in substeps bounded by the clearance: at no point does a sphere penetrate a surface by
/// more than ProxySettings::max_penetration_mm. Bounded work; does not allocate, lock or throw.
///
/// - Capsules are represented by a row of spheres, spaced so that their outline is at most 0.01 mm inside the
///   capsule's, or 0.15 mm apart if that is larger (docs/decisions/archive/0023). The contact point is the
///   nearest point, or the middle of the touching interval where the capsule lies along the surface.
/// - Rotation: the proxy's attitude follows the operator's without resistance. Where the tool rotates into a
///   surface, the proxy's position is pushed out of it, and the resulting distance to the tip generates the
///   force (docs/decisions/archive/0019).
/// - Free space is crossed in substeps of the clearance (sphere tracing, Hart 1996).
/// - In contact the goal is the point nearest to the tip in the intersection of the half-spaces of all
///   touched surfaces, found by an active-set method; corners, gaps and notches need no special case.
/// - Slip: where the goal jumps, e.g. at an edge, the proxy approaches it, if necessary through free space,
///   at a speed that changes the spring force by at most max_slip_N_per_s. A punctured surface releases at
///   once (docs/decisions/0033). The stiffness is rate-limited in the same way when the proxy moves from one
///   structure to another under load.
/// - A layer constrains the tool only while the covering layer does. Once the outer proxy coincides with the
///   tip, the tip is outside all inner layers: their proxies are reset to the tip and their residual force
///   fades at the slip rate (docs/decisions/0076-layers-hold-while-covered.md).
/// - The outermost layer constrains the tool until it has returned from the tissue, i.e. it is clear of the
///   layer and the straight path to the last free pose is free. A proxy still trapped elsewhere, for example
///   in a pocket of the surface, is then reset in the same way.
/// - Friction: the proxy sticks while its tangential distance from the frictionless goal is at most the
///   static coefficient times the depth; otherwise it slides to a distance of the kinetic coefficient times
///   the depth from that goal (friction cone: Harwin & Melder 2002).
/// - Stiffness and friction are averaged over the touched structures, weighted by the contact multipliers
///   and, on a common surface, by the ownership shares. Each layer has its own proxy, and the forces add up.
/// - Puncture: a structure is punctured when its contribution to the spring force exceeds its puncture force.
///   This excludes friction and uses the unlimited stiffness. Puncture also opens the common surfaces that
///   the structure is part of, so that surfaces beneath are then touched individually; each closes again when
///   tip and proxy have left it. A structure with stays_open keeps a hole: while all tool parts in contact
///   with it fit into its holes, it is passed again without force.
///
/// @param surfaces   at most kMaxSurfaces; the same in every call with one `state`
/// @param parts      1 ... kMaxToolParts tool parts, in the attitude of `tool_pose`
/// @param tool_pose  pose of the tool
/// @param state      state of this tool, updated
ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options = {});

/// Transfers the state to a changed set of surfaces. Proxies are unaffected by surfaces whose shape is
/// unchanged: position, sticking and punctures stay. A structure that was punctured and has changed shape
/// stays punctured. A proxy inside a surface that is new or changed shape is uncoupled, because the side on
/// which it belongs is unknown.
/// @param tool_pose        pose of the tool, in whose attitude `spheres` are given
/// @param correspondences  correspondence for each of `surfaces`; empty: unknown, all surfaces are new
void transfer_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                    const ToolPose& tool_pose, std::span<const SurfaceCorrespondence> correspondences,
                    ProxyState& state);

/// Couples a tip that is inside tissue: each layer's proxy is initialised at the nearest point outside all
/// surfaces. Returns false if there is none within reach of the distance fields. The caller ramps the force
/// in.
bool initialise_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                      const ToolPose& tool_pose, ProxyState& state);

/// Transfers the state to surfaces whose structures have been assigned to different layers. The outermost
/// proxy is treated as by transfer_proxy. If it was uncoupled, and for all inner layers, a proxy is
/// initialised at the nearest point outside the surfaces that the tool has not punctured; punctures stay. The
/// deformation and relaxation states are reset. A tip that was uncoupled before stays without force until it
/// is in free space. The caller blends the force.
/// @param correspondences  as for transfer_proxy
void transfer_proxy_to_new_layers(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts,
                                  const ToolPose& tool_pose,
                                  std::span<const SurfaceCorrespondence> correspondences, ProxyState& state);

}  // namespace palpate
