#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "palpate/contact/contact_settings.h"
#include "palpate/contact/holes.h"
#include "palpate/contact/owners.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/sampling/surface.h"

/// God-object / proxy contact. A proxy of the tool tip is constrained to stay outside the surfaces while the
/// device's tip penetrates them, and a virtual spring from the tip to the proxy generates the force (Zilles &
/// Salisbury 1995; on implicit surfaces Salisbury & Tarr 1997). Positions are in the patient frame, so a
/// proxy that sticks by friction moves along with a rotating object.
namespace palpate {

/// A surface with its contact properties: the surface of one structure, or a common surface of structures
/// that touch. Touching structures share a surface because two separate surfaces side by side are both
/// rounded at the seam and a tool would fall into the crack between them.
///
/// Structures that are stiffer than their surroundings form layers. Where fat and bone touch, the outer layer
/// is their common surface, with the stiffness of fat; the surface of bone lies in the next layer, with the
/// difference between the stiffness of bone and that of fat. Each layer constrains its own proxy, so the
/// total force is the stiffness integrated along the penetration path, as in the inward ramp
/// (docs/decisions/archive/0011-inward-ramps.md), and each layer's force is that of a conservative spring.
///
/// For a deformable structure the contact force at a depth is computed from the elastic solution
/// (soft_contact.h) instead of from a spring stiffness. A deformable structure belongs to the outermost of
/// the layers that it touches; rigid structures within keep their whole stiffness.
struct ContactSurface : ContactProperties {
  /// Signed-distance surface. null: the structure has no surface of its own and is in contact only through
  /// common surfaces.
  std::shared_ptr<const Surface> surface;
  /// Normal force above which the tool punctures the structure; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
  bool stays_open = false;  ///< Whether a puncture leaves a permanent hole (holes.h)
  /// Ownership of a common surface: contact properties there are averaged over the owning structures by their
  /// shares and replace the values above. null: not a common surface.
  std::shared_ptr<const Owners> owners = nullptr;
  /// Index of the structure to which this additional surface belongs, in a layer outside that structure's
  /// own. -1: the entry is a structure's own, or a common surface.
  int structure = -1;
  /// Index of the common surface that covers this one; this surface is only tested for contact while the tool
  /// has punctured that one. -1: not covered.
  int covered_by = -1;
  /// Indices of the structures whose puncture also opens this common surface.
  std::vector<std::int16_t> opened_by = {};
  /// Layer index, 0 is the outermost. The entry of a structure has the innermost layer that contributes to
  /// its stiffness.
  int layer = 0;
  /// Stiffness interval contributed by this layer, N/mm. In a structure's own layer the interval has no upper
  /// bound: the contribution is all stiffness above lower_N_per_mm.
  double lower_N_per_mm = 0, upper_N_per_mm = std::numeric_limits<double>::infinity();
  /// Specific cutting energy: work of a burr's motor per volume removed (palpate/tissue/removal.h). Infinite:
  /// a burr cannot cut it.
  double cutting_energy_mJ_per_mm3 = std::numeric_limits<double>::infinity();
  /// Surface before any tissue was removed (palpate/tissue/carving.h), and the labels from which it was
  /// built; null if nothing was removed. Points below that surface are owned according to these labels.
  std::shared_ptr<const Surface> original_surface = nullptr;
  std::shared_ptr<const Bricks<LabelId>> original_labels = nullptr;
  /// Whether burrs are blocked from removing this structure (palpate/tissue/removal.h).
  bool is_protected = false;
  /// Maximum amount by which Surface::distance_mm() underestimates the distance to a carved part of the
  /// surface (CarvedSurface::clearance_error_mm).
  double clearance_error_mm = 0;
  /// Plane-strain modulus E / (1 - nu^2) of a deformable structure. 0: not deformable, a spring.
  double plane_strain_modulus_N_per_mm2 = 0;
  /// Exponent of a deformable structure's strain stiffening (ElasticConstants::stiffening). 0: none.
  double strain_stiffening = 0;
  /// Relaxation fractions of a deformable structure, one per time constant of the model.
  RelaxationFractions relaxed = {};
};
/// A touchable structure that a burr should spare.
struct ProtectedStructure {
  LabelId label = 0;
  std::shared_ptr<const Surface> surface;  ///< The structure's own surface before any removal
  bool is_protected = false;               ///< Whether burrs are blocked from removing it
};
/// Ownership of a surface point: on a common surface the shares of its structures at that point, otherwise
/// the one structure with share 1.
/// @param index  index into `surfaces`
OwnerFractions owners_at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& at);
/// Cache of the last four owner lookups. A tool at rest on a few contacts looks up the same points in every
/// tick.
class OwnerCache {
 public:
  /// Result of owners_at(), taken from the cache if available.
  OwnerFractions at(std::span<const ContactSurface> surfaces, int index, const Point<Patient>& position);

 private:
  struct Entry {
    std::uint64_t owners = 0;  ///< Owners::number(). 0: empty entry
    int surface = -1;
    /// Whether tissue had been removed from the surface; the original surface and labels do not change
    /// afterwards.
    bool cut = false;
    Point<Patient> position;
    OwnerFractions fractions;
  };
  std::array<Entry, 4> entries_;
  std::size_t next_ = 0;
};
/// Maximum number of surfaces of a model.
inline constexpr std::size_t kMaxSurfaces = 1024;
/// Set of surfaces, by their index.
using SurfaceSet = std::bitset<kMaxSurfaces>;

/// A collision primitive of the tool: a sphere, or a capsule (a sphere swept along a segment) whose radius
/// may change linearly along its axis. A point tool is a sphere of radius 0.
struct ToolSphere {
  Vector<Patient> offset_mm;  ///< Centre relative to the tip, in the tool's current attitude
  double radius_mm = 0;
  /// Axis of a capsule, from the end at offset_mm to the other end; mm. 0: a sphere.
  Vector<Patient> axis_mm = {};
  /// Radius at the other end of a capsule minus radius_mm; negative where it tapers. If not 0, both radii are
  /// above 0.
  double radius_change_mm = 0;
  /// Radius from which the spacing of a capsule's row of spheres is computed; 0: the capsule's own radius. A
  /// fixed value keeps the spheres at the same axis positions when the radius changes.
  double row_radius_mm = 0;

  /// @param axis_fraction  position on the axis, 0 at offset_mm ... 1 at the other end
  double radius_at_mm(double axis_fraction) const { return radius_mm + radius_change_mm * axis_fraction; }
};
/// Maximum number of spheres and capsules of a tool.
inline constexpr std::size_t kMaxToolSpheres = 4;

/// Closest approach of a tool part to a surface.
struct NearestPart {
  /// Signed distance from the nearest point of the part's axis to the surface, minus the increase of the
  /// capsule's radius from offset_mm to that point; mm. The clearance is distance_mm - ToolSphere::radius_mm.
  double distance_mm = 0;
  double axis_fraction = 0;  ///< Position on the axis, 0 ... 1
};
/// Closest approach, evaluated on the same row of spheres that the proxy uses for a capsule. Does not
/// allocate, lock or throw.
/// @param at         position of the tip
/// @param cutoff_mm  early-out for capsules: if the distance is nowhere below this, the result may be any
///                   lower bound above it
NearestPart nearest_part(const Surface& surface, const ToolSphere& sphere, const Point<Patient>& at,
                         double cutoff_mm = std::numeric_limits<double>::infinity());

/// Pose of the tool as held by the operator.
struct ToolPose {
  Point<Patient> tip;           ///< Position of the tip; finite
  Eigen::Quaterniond attitude;  ///< Rotation from tool axes to patient axes; unit quaternion

  /// Pose with the tip at `at`; the attitude defaults to the identity.
  /// @param turned  attitude; any non-zero norm, normalised by the constructor
  ToolPose(const Point<Patient>& at, const Eigen::Quaterniond& turned = Eigen::Quaterniond::Identity())
      : tip(at), attitude(turned.normalized()) {}
};

/// Tool parts rotated from one attitude to another. Bit-identical to the input if both attitudes are equal.
class RotatedTool {
 public:
  /// @param spheres  parts in attitude `from`; at most kMaxToolSpheres
  RotatedTool(std::span<const ToolSphere> spheres, const Eigen::Quaterniond& from,
              const Eigen::Quaterniond& to);
  std::span<const ToolSphere> spheres() const { return {spheres_.data(), count_}; }

 private:
  std::array<ToolSphere, kMaxToolSpheres> spheres_;
  std::size_t count_;
};

/// A contact between a sphere or capsule of the tool and a surface.
struct ProxyContact {
  int surface = -1;          ///< Index into the surfaces
  int sphere = 0;            ///< Index of the tool part
  double axis_fraction = 0;  ///< Position on a capsule's axis, 0 at offset_mm ... 1 at the other end
  Vector<Patient> normal;    ///< Outward surface normal; unit
  /// Constraint multiplier: component along `normal` that this contact contributes to the vector from tip to
  /// proxy.
  double multiplier_mm = 0;
};
/// Lever arm: vector from the tip to the contact point.
inline Vector<Patient> arm_of(const ProxyContact& contact, const ToolSphere& sphere) {
  return sphere.offset_mm + sphere.axis_mm * contact.axis_fraction -
         contact.normal * sphere.radius_at_mm(contact.axis_fraction);
}
/// Friction coefficients of a contact.
struct Friction {
  double static_coefficient = 0, kinetic_coefficient = 0;
};
/// Cache of the active contacts of a proxy at rest. It is valid while the same tool remains at the same
/// position with the same punctured surfaces; a tick then needs no surface queries. Not used for tools with
/// capsules.
class RestingContacts {
 public:
  struct Constraint {
    Vector<Patient> normal;  ///< Outward normal; unit
    double offset_mm = 0;    ///< Half-space of allowed tip proxies: normal . p >= offset_mm
    int surface = -1, sphere = 0;
    /// Friction coefficients; empty unless they were evaluated.
    std::optional<Friction> friction = std::nullopt;
  };
  static constexpr std::size_t kMaxConstraints = 4;

  /// Cached half-spaces; empty if the cache does not match these arguments.
  std::span<const Constraint> find(const Point<Patient>& position, const SurfaceSet& punctured,
                                   std::span<const ToolSphere> spheres) const;
  void store(const Point<Patient>& position, const SurfaceSet& punctured, std::span<const ToolSphere> spheres,
             std::span<const Constraint> constraints);
  void invalidate() { count_ = 0; }

 private:
  struct Sphere {
    Vector<Patient> offset_mm;
    double radius_mm = 0;
  };
  std::array<Constraint, kMaxConstraints> constraint_;
  std::size_t count_ = 0, spheres_ = 0;
  Point<Patient> position_;
  SurfaceSet punctured_;
  std::array<Sphere, kMaxToolSpheres> sphere_;
};
/// Maximum number of contacts of a layer: three active half-spaces (a corner) for every part of the tool.
inline constexpr std::size_t kMaxContacts = 3 * kMaxToolSpheres;

/// Maximum number of layers (docs/decisions/0077-twelve-layers.md).
inline constexpr int kMaxLayers = 12;

/// State of one layer's proxy between ticks.
struct ProxyLayer {
  /// Whether the proxy constrains the tip. After a contact reset (start, clutch, pause, jump, a surface that
  /// grew over the tip) it is false, and the force zero, until the tip has been in free space: before that,
  /// the free side of the surface is unknown.
  bool coupled = false;
  bool sticking = false;    ///< Whether static friction holds the proxy
  Point<Patient> position;  ///< Position of the tip's proxy
  /// Attitude of the proxy's tool, as in ToolPose. Differs from the operator's while contacts block the
  /// rotation or the work limit of a tick was reached.
  Eigen::Quaterniond attitude = Eigen::Quaterniond::Identity();
  /// Last substep displacement, mm; used to damp oscillation between substeps
  Vector<Patient> last_displacement;
  SurfaceSet punctured;  ///< Bit n: the tool has punctured surface n and not left it yet
  /// Fraction of the vector from tip to proxy that stretches the spring. Below 1 where the proxy is blocked
  /// by a surface although no half-space constraint explains it.
  double stretch_fraction = 1;
  /// Spring stiffness of the last tick (force over length). 0: the spring was inactive. Empty: unknown, e.g.
  /// after the surfaces changed.
  std::optional<double> spring_N_per_mm;
  /// Displacement of the device while the proxy was catching up through free space at zero force.
  double catch_up_mm = 0;
  double stranded_s = 0;  ///< Time since the proxy stopped farther than ProxySettings::lost_mm from a tip in
                          ///< free space
  int contact_count = 0;  ///< Number of valid entries of `contacts`
  std::array<ProxyContact, kMaxContacts> contacts;
};

/// Caches of one layer's proxy. They affect the time of a tick but not its result.
struct ProxyLayerCache {
  OwnerCache owners;
  RestingContacts at_rest;
};

/// Residual force of layers whose proxies were released because the tool has left the covering layer. It
/// fades out at a limited rate.
struct ResidualForce {
  Vector<Patient> force_N;     ///< Force on the tip
  Vector<Patient> torque_Nmm;  ///< Torque about the tip
  double stored_mJ = 0;        ///< Elastic energy of a spring with that force

  /// Reduces the magnitude of the force by at most `max_N`. Returns the reduction, N.
  double fade(double max_N);
  /// Limits the magnitude of the force to `max_N`.
  void limit(double max_N);
};

/// Contact state of one tool between ticks: the outermost layer (base class) and the layers within. Trivially
/// copyable, without pointers.
struct ProxyState : ProxyLayer {
  std::array<ProxyLayer, kMaxLayers - 1> inner_layers;  ///< Layer n at n - 1
  Point<Patient> tip;                                   ///< Tip position of the last tick
  double stiffness_N_per_mm = 0;  ///< Sum of the layers' tangent stiffnesses in the last tick. 0: no contact
  ComplianceState compliance;     ///< State of the deformable structures of the outermost layer
  RelaxationState relaxation;     ///< Relaxation state of the outermost layer
  ResidualForce release;
  /// Last tip position in free space, where the outermost proxy coincided with the tip.
  Point<Patient> free_tip;
  Eigen::Quaterniond free_attitude = Eigen::Quaterniond::Identity();  ///< Attitude of the tool at free_tip
  Point<Patient> last_search_tip;  ///< Tip position at the last search for a free path back to the free pose
  std::array<ProxyLayerCache, kMaxLayers> caches;  ///< By layer; not part of the physical state

  const ProxyLayer& layer(int n) const {
    return n == 0 ? *this : inner_layers[static_cast<std::size_t>(n - 1)];
  }
  ProxyLayer& layer(int n) { return n == 0 ? *this : inner_layers[static_cast<std::size_t>(n - 1)]; }
  ProxyLayerCache& cache(int n) { return caches[static_cast<std::size_t>(n)]; }
  /// Resets all layers but the outermost.
  void reset_inner_layers() {
    inner_layers = {};
    for (std::size_t n = 1; n < caches.size(); ++n) caches[n].at_rest.invalidate();
  }
};

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
  std::span<const TissueContact> presses = {};
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
/// @param surfaces  at most kMaxSurfaces; the same in every call with one `state`
/// @param spheres   1 ... kMaxToolSpheres tool parts, in the attitude of `tool_pose`
/// @param tool_pose      pose of the tool
/// @param state     state of this tool, updated
ProxyResult advance_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                          const ToolPose& tool_pose, ProxyState& state, const ProxyOptions& options = {});

/// Transfers the state to a changed set of surfaces. Proxies are unaffected by surfaces whose shape is
/// unchanged: position, sticking and punctures stay. A structure that was punctured and has changed shape
/// stays punctured. A proxy inside a surface that is new or changed shape is uncoupled, because the side on
/// which it belongs is unknown.
/// @param tool_pose    pose of the tool, in whose attitude `spheres` are given
/// @param correspondences  correspondence for each of `surfaces`; empty: unknown, all surfaces are new
void transfer_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                    const ToolPose& tool_pose, std::span<const SurfaceCorrespondence> correspondences,
                    ProxyState& state);

/// Couples a tip that is inside tissue: each layer's proxy is initialised at the nearest point outside all
/// surfaces. Returns false if there is none within reach of the distance fields. The caller ramps the force
/// in.
bool initialise_proxy(std::span<const ContactSurface> surfaces, std::span<const ToolSphere> spheres,
                      const ToolPose& tool_pose, ProxyState& state);

/// Transfers the state to surfaces whose structures have been assigned to different layers. The outermost
/// proxy is treated as by transfer_proxy. If it was uncoupled, and for all inner layers, a proxy is
/// initialised at the nearest point outside the surfaces that the tool has not punctured; punctures stay. The
/// deformation and relaxation states are reset. A tip that was uncoupled before stays without force until it
/// is in free space. The caller blends the force.
/// @param correspondences  as for transfer_proxy
void transfer_proxy_to_new_layers(std::span<const ContactSurface> surfaces,
                                  std::span<const ToolSphere> spheres, const ToolPose& tool_pose,
                                  std::span<const SurfaceCorrespondence> correspondences, ProxyState& state);

}  // namespace palpate
