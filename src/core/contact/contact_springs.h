#pragma once

#include <limits>
#include <optional>
#include <span>

#include "contact/deformable_contact.h"
#include "contact/force_continuity.h"
#include "contact/penetration_path.h"
#include "contact/puncture.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy.h"

/// Force stage of the proxy: a virtual spring from the tip to each layer's proxy.
namespace palpate {

/// Torque about the tip of a layer's force. The part of the force that the normal forces do not explain is
/// friction, and is distributed over the contacts by their multipliers.
Vector<Patient> torque_of(std::span<const ProxyContact> contacts, std::span<const ToolSphere> spheres,
                          const Vector<Patient>& force_N, double stiffness_N_per_mm);

/// Stiffness that a layer contributes for a structure, clamped to the device's limit: the structure's
/// stiffness up to the layer's upper bound, minus the part already provided by the outer layers. That part is
/// the layer's lower bound, or the sum actually given if the surrounding structures are softer than their own
/// layer's upper bound; the difference would otherwise be missing from every layer within.
class LayerStiffness {
 public:
  explicit LayerStiffness(double max_N_per_mm) : max_N_per_mm_(max_N_per_mm) {}

  /// Contribution of a layer's `surface` for `structure`; N/mm.
  double contribution(const ContactSurface& surface, const ContactSurface& structure) const;
  /// Adds the mean contribution of a layer, from outside to inside.
  void add(double mean_N_per_mm) {
    if (given_N_per_mm_) *given_N_per_mm_ += mean_N_per_mm;
  }
  /// Reverts to the layers' lower bounds, after a layer without contact or with a deformable structure.
  void forget() { given_N_per_mm_.reset(); }

 private:
  double max_N_per_mm_;
  std::optional<double> given_N_per_mm_ = 0;
};

/// A layer's proxy at the end of its update, for the force of its spring.
struct SpringInputs {
  const ProxyLayer& layer;
  std::span<const ToolSphere> spheres;  ///< Tool parts in the proxy's attitude
  const SpringMotion& motion;
  /// Whether the proxy has reached its goal. Otherwise the spring does not measure the operator's force, and
  /// nothing may be punctured by it.
  bool has_arrived = false;
  double slip_N = 0;  ///< Permitted force change in this tick beyond the tip's displacement

  std::span<const ProxyContact> contacts() const {
    return std::span(layer.contact).first(static_cast<std::size_t>(layer.contacts));
  }
};

/// Spring forces, summed over layers.
class ContactSprings {
 public:
  ContactSprings(std::span<const ContactSurface> surfaces, const Point<Patient>& tip,
                 const ProxyOptions& options)
      : surfaces_(surfaces),
        tip_(tip),
        options_(options),
        rendered_(options.max_stiffness_N_per_mm),
        own_(std::numeric_limits<double>::infinity()) {}

  /// Adds a layer; layers are added from outside to inside.
  /// @param yield  state of the deformable structures, used by the outermost layer only
  /// @return the layer's force
  ProxyForce add(const SpringInputs& in, OwnerCache& owners, ComplianceState& yield,
                 RelaxationState& relaxation);

  /// Advances the relaxation state by one tick if add() found no relaxing contact.
  void recover(RelaxationState& relaxation) const {
    if (options_.relaxation_times == nullptr || relaxed_) return;
    advance_relaxation(*options_.relaxation_times, 0, nullptr, options_.dt_s, relaxation);
  }

  Vector<Patient> normal() const { return normals_N_.normalized(); }
  double friction() const { return options_.friction && normal_N_ > 0 ? friction_N_ / normal_N_ : 0; }
  const PunctureForces& puncture_forces() const { return puncture_forces_; }
  const PenetrationPath& path() const { return path_; }

 private:
  // contact properties of a layer, averaged over its contacts by their multipliers and ownership shares
  struct LayerMean {
    double multiplier_mm = 0;  // sum over the contacts
    double stiffness = 0;      // contributed by rigid structures, clamped to the device's limit
    double own_stiffness = 0;  // the same, not clamped
    double friction = 0;       // weighted by the multipliers
    DeformableContact pressed;
  };
  LayerMean average(const SpringInputs& in, OwnerCache& owners);
  void forget_outer_layers() {
    rendered_.forget();
    own_.forget();
  }
  void add_puncture_forces(std::span<const ProxyContact> contacts, double own_stiffness);

  std::span<const ContactSurface> surfaces_;
  const Point<Patient> tip_;
  const ProxyOptions options_;
  LayerStiffness rendered_, own_;
  UninitialisedArray<OwnerShares, kMaxContacts> owners_;  // by contact of the layer that was added last
  PenetrationPath path_;
  Vector<Patient> normals_N_;
  double friction_N_ = 0, normal_N_ = 0;
  bool relaxed_ = false;
  PunctureForces puncture_forces_;
};

}  // namespace palpate
