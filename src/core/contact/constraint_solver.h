#pragma once

#include <bitset>
#include <cstddef>
#include <optional>
#include <span>

#include "contact/half_spaces.h"
#include "contact/near_surfaces.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy.h"

/// Solve stage of a substep: goal of the proxy under half-space constraints and friction.
namespace palpate {

/// Friction coefficients of the gathered pairs, cached. Each pair is evaluated once per gathering, at the
/// contact point of its first active constraint.
class PairFriction {
 public:
  void clear() { evaluated_.reset(); }
  /// Coefficients of pair `pair`; nullptr: not evaluated yet.
  const Friction* find(std::size_t pair) const { return evaluated_[pair] ? &friction_[pair] : nullptr; }
  const Friction& store(std::size_t pair, const Friction& friction) {
    evaluated_[pair] = true;
    return friction_.make(pair, friction);
  }

 private:
  std::bitset<kMaxPairs> evaluated_;
  UninitialisedArray<Friction, kMaxPairs> friction_;
};

/// Friction state of a proxy during its update.
struct FrictionState {
  /// Whether `anchor` is valid, i.e. the proxy is in contact; whether static rather than kinetic friction
  /// applies.
  bool anchored = false, sticking = false;
  /// Proxy position at the beginning of the update or of the contact; friction displaces the goal towards it.
  Point<Patient> anchor;

  /// Sets the anchor if contact begins in this update.
  void begin_contact(const Point<Patient>& proxy) {
    if (anchored) return;
    anchor = proxy;
    anchored = true;
    sticking = false;
  }
};

/// Inputs of the solver: the tip's position and the constraints of its proxy.
struct ContactProblem {
  std::span<const ContactSurface> surfaces;
  const PairSet& pairs;
  const ContactConstraints& constraints;
  Point<Patient> tip, proxy;
  bool friction = true;  ///< Whether friction is rendered
};

/// Result of the solver.
struct Solution {
  ClosestPoint nearest;    ///< Goal without friction, with its active set and multipliers
  Point<Patient> goal;     ///< Goal with friction
  FrictionState friction;  ///< Friction state at the goal
  /// Decrease of the friction cone's radius if static friction changed to kinetic: the distance that the
  /// proxy may slip at once, beyond its displacement limit. Empty: no such change.
  std::optional<double> released_mm;
};

/// Goal of the proxy: the point nearest to the tip in the intersection of all half-spaces (Zilles & Salisbury
/// 1995, with the tool's size as in Ruspini et al. 1997), displaced towards the friction anchor by at most
/// the friction cone's radius at this depth (Harwin & Melder 2002).
/// @param before        friction state before the substep
/// @param coefficients  friction coefficients of the problem's pairs; missing ones are evaluated and added
/// @return empty if the half-spaces have no common point
std::optional<Solution> solve_constraints(const ContactProblem& problem, const FrictionState& before,
                                          PairFriction& coefficients, OwnerCache& owners);

/// Origin of a contact in the gathered pairs.
struct ContactOrigin {
  std::size_t pair = 0;  ///< Index of the sphere-surface pair
  int step = 0;          ///< Index of the sphere in a capsule's row
};
using ContactOrigins = UninitialisedArray<ContactOrigin, kMaxContacts>;

/// Adds a contact unless the layer has kMaxContacts.
void add_contact(const PairSet& pairs, const ContactOrigin& origin, const Vector<Patient>& normal,
                 double multiplier_mm, ProxyLayer& layer, ContactOrigins& origins);

/// Replaces a layer's contacts by the active constraints. Constraints parallel to an active one and within
/// ProxySettings::load_sharing_mm of the goal, e.g. of a second sphere on the same plane, share its
/// multiplier.
void store_contacts(const ClosestPoint& nearest, const PairSet& pairs, const ContactConstraints& constraints,
                    ProxyLayer& layer, ContactOrigins& origins);

}  // namespace palpate
