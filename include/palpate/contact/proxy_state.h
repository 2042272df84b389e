#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <span>

#include "palpate/contact/contact_surface.h"
#include "palpate/contact/soft_contact.h"
#include "palpate/contact/tool_shape.h"

/// State of the proxy that persists between ticks.
namespace palpate {

/// A contact between a sphere or capsule of the tool and a surface.
struct ProxyContact {
  int surface = -1;          ///< Index into the surfaces
  int part = 0;              ///< Index of the tool part
  double axis_fraction = 0;  ///< Position on a capsule's axis, 0 at offset_mm ... 1 at the other end
  Vector<Patient> normal;    ///< Outward surface normal; unit
  /// Constraint multiplier: component along `normal` that this contact contributes to the vector from tip to
  /// proxy.
  double multiplier_mm = 0;
};
/// Lever arm: vector from the tip to the contact point.
inline Vector<Patient> arm_of(const ProxyContact& contact, const ToolPart& part) {
  return part.offset_mm + part.axis_mm * contact.axis_fraction -
         contact.normal * part.radius_at_mm(contact.axis_fraction);
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
    int surface = -1, part = 0;
    /// Friction coefficients; empty unless they were evaluated.
    std::optional<Friction> friction = std::nullopt;
  };
  static constexpr std::size_t kMaxConstraints = 4;

  /// Cached half-spaces; empty if the cache does not match these arguments.
  std::span<const Constraint> find(const Point<Patient>& position, const SurfaceSet& punctured,
                                   std::span<const ToolPart> parts) const;
  void store(const Point<Patient>& position, const SurfaceSet& punctured, std::span<const ToolPart> parts,
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
  std::array<Sphere, kMaxToolParts> sphere_;
};
/// Maximum number of contacts of a layer: three active half-spaces (a corner) for every part of the tool.
inline constexpr std::size_t kMaxContacts = 3 * kMaxToolParts;

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

}  // namespace palpate
