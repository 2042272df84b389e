#pragma once

#include <limits>
#include <optional>
#include <span>

#include "contact/deformable_contact.h"
#include "contact/force_continuity.h"
#include "contact/penetration_path.h"
#include "contact/puncture.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/neighbour_tools.h"
#include "palpate/contact/proxy.h"

/// Force stage of the proxy: a virtual spring from the tip to each layer's proxy.
namespace palpate {

/// Torque about the tip of a layer's force. Each contact contributes its normal force (stiffness times
/// multiplier). The remainder of the force is friction, distributed over the contacts in proportion to their
/// multipliers.
/// @param parts  tool parts in the proxy's attitude
Vector<Patient> torque_of(std::span<const ProxyContact> contacts, std::span<const ToolPart> parts,
                          const Vector<Patient>& force_N, double stiffness_N_per_mm);

/// Division of a structure's stiffness, clamped to the device's limit, among the layers. A layer contributes
/// the stiffness from the sum provided by the outer layers to its own upper bound; the structure's own layer
/// has no upper bound. The outer layers nominally provide the layer's lower bound. They provide less where
/// the structures that they touch are softer than that bound; the actual sum then applies, since the
/// difference would otherwise be missing from the total.
class LayerStiffness {
 public:
  explicit LayerStiffness(double max_N_per_mm) : max_N_per_mm_(max_N_per_mm) {}

  /// Contribution of a layer's `surface` for `structure`; N/mm.
  double contribution(const ContactSurface& surface, const ContactSurface& structure) const;
  /// Adds a layer's mean contribution to the sum provided by the outer layers. Layers are added from outside
  /// to inside.
  void add(double mean_N_per_mm) {
    if (contributed_N_per_mm_) *contributed_N_per_mm_ += mean_N_per_mm;
  }
  /// Makes the layers' lower bounds apply from now on: after a layer without contact, or with a deformable
  /// structure, the sum is unknown.
  void invalidate() { contributed_N_per_mm_.reset(); }

 private:
  double max_N_per_mm_;
  std::optional<double> contributed_N_per_mm_ = 0;  // sum provided by the outer layers; empty: unknown
};

/// Inputs of one layer's spring force, after the update of the layer's proxy.
struct SpringInputs {
  const ProxyLayer& layer;
  std::span<const ToolPart> parts;  ///< Tool parts in the proxy's attitude
  const SpringMotion& motion;
  /// Whether the proxy has reached its goal. Otherwise the spring force is not that of an equilibrium, and
  /// nothing is punctured.
  bool has_arrived = false;
  double slip_N = 0;  ///< Permitted force change in this tick beyond that caused by the tool's displacement

  std::span<const ProxyContact> contacts() const {
    return std::span(layer.contacts).first(static_cast<std::size_t>(layer.contact_count));
  }
};

/// Spring forces of one tick, with the totals over all layers.
class ContactSprings {
 public:
  ContactSprings(std::span<const ContactSurface> surfaces, const Point<Patient>& tip,
                 const ProxyOptions& options)
      : surfaces_(surfaces),
        tip_(tip),
        options_(options),
        clamped_(options.max_stiffness_N_per_mm),
        unclamped_(std::numeric_limits<double>::infinity()) {}

  /// Adds a layer; layers are added from outside to inside.
  /// @param compliance  state of the deformable structures, used by the outermost layer only
  /// @return the layer's force
  ProxyForce add(const SpringInputs& in, OwnerCache& owners, ComplianceState& compliance,
                 RelaxationState& relaxation);

  /// Advances the relaxation state by one tick if add() found no relaxing contact.
  void recover(RelaxationState& relaxation) const {
    if (options_.relaxation_times == nullptr || relaxed_) return;
    advance_relaxation(*options_.relaxation_times, 0, nullptr, options_.dt_s, relaxation);
  }

  /// Force-weighted mean of the contact normals; zero without contact.
  Vector<Patient> normal() const { return normals_N_.normalized(); }
  /// Force-weighted mean of the friction coefficients in effect; 0 without contact or friction.
  double friction() const { return options_.friction && normal_N_ > 0 ? friction_N_ / normal_N_ : 0; }
  const PunctureForces& puncture_forces() const { return puncture_forces_; }
  const PenetrationPath& path() const { return path_; }
  /// Contact with deformable tissue; unset if there is none.
  const TissueContact& tissue_contact() const { return tissue_contact_; }

 private:
  // contact properties of a layer, averaged over its contacts by their multipliers and ownership shares
  struct LayerMean {
    double multiplier_mm = 0;        // sum over the contacts
    double stiffness = 0;            // contributed by rigid structures, clamped to the device's limit
    double unclamped_stiffness = 0;  // the same, not clamped; it determines puncture
    double friction = 0;             // sum of the coefficients, weighted by the multipliers
    DeformableContact pressed;       // contact with deformable structures
  };
  LayerMean average(const SpringInputs& in, OwnerCache& owners);
  void invalidate_outer_layers() {
    clamped_.invalidate();
    unclamped_.invalidate();
  }
  void add_puncture_forces(std::span<const ProxyContact> contacts, double unclamped_stiffness);

  std::span<const ContactSurface> surfaces_;
  const Point<Patient> tip_;
  const ProxyOptions options_;
  // clamped to the device's limit, and not clamped
  LayerStiffness clamped_, unclamped_;
  UninitialisedArray<OwnerFractions, kMaxContacts> owners_;  // by contact of the layer that was added last
  PenetrationPath path_;
  Vector<Patient> normals_N_;
  double friction_N_ = 0, normal_N_ = 0;
  bool relaxed_ = false;  // whether a layer's contact has advanced the relaxation state
  PunctureForces puncture_forces_;
  TissueContact tissue_contact_;
};

}  // namespace palpate
