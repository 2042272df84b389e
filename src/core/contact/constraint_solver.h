#pragma once

#include <bitset>
#include <cstddef>
#include <optional>
#include <span>

#include "contact/half_spaces.h"
#include "contact/near_surfaces.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy.h"

/// Solve stage of a substep: the goal of the proxy under the gathered constraints.
namespace palpate {

/// Friction coefficients of the gathered pairs. Each is evaluated once, where its constraint is first met.
class PairFriction {
 public:
  void clear() { evaluated_.reset(); }
  /// Coefficients of a pair; nullptr: not evaluated yet.
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
  bool anchored = false, sticking = false;
  Point<Patient> anchor;  ///< Position at which friction holds the proxy; valid if anchored

  /// Sets the anchor when contact begins.
  void begin_contact(const Point<Patient>& proxy) {
    if (anchored) return;
    anchor = proxy;
    anchored = true;
    sticking = false;
  }
};

/// Constraints of a proxy, whose goal is the allowed point nearest to the tip.
struct ContactProblem {
  std::span<const ContactSurface> surfaces;
  const PairSet& pairs;
  const ContactConstraints& constraints;
  Point<Patient> tip, proxy;
  bool friction = true;  ///< Whether friction is rendered
};

/// Goal of a proxy.
struct Solution {
  ClosestPoint nearest;    ///< Goal without friction, with its active set and multipliers
  Point<Patient> goal;     ///< Goal with friction
  FrictionState friction;  ///< Friction state at the goal
  /// Distance released because static friction changed to kinetic; it is exempt from the displacement limit.
  std::optional<double> released_mm;
};

/// Goal of the proxy: the point nearest to the tip in the intersection of all half-spaces (Zilles & Salisbury
/// 1995, with the tool's size as in Ruspini et al. 1997), displaced towards the friction anchor by at most
/// the friction cone's radius at this depth (Harwin & Melder 2002).
/// @param before        friction state before the substep
/// @param coefficients  friction of the problem's pairs, completed
/// @return empty if the half-spaces have no common point
std::optional<Solution> solve_constraints(const ContactProblem& problem, const FrictionState& before,
                                          PairFriction& coefficients, OwnerCache& owners);

/// Origin of a contact: index of its sphere-surface pair, and the sphere in the capsule's row.
struct ContactOrigin {
  std::size_t pair = 0;
  int step = 0;
};
using ContactOrigins = UninitialisedArray<ContactOrigin, kMaxContacts>;

/// Adds a contact unless the layer has kMaxContacts.
void add_contact(const PairSet& pairs, const ContactOrigin& origin, const Vector<Patient>& normal,
                 double multiplier_mm, ProxyLayer& layer, ContactOrigins& origins);

/// Replaces a layer's contacts by the active constraints. Parallel constraints share the multiplier, e.g. two
/// spheres on one plane.
void store_contacts(const ClosestPoint& nearest, const PairSet& pairs, const ContactConstraints& constraints,
                    ProxyLayer& layer, ContactOrigins& origins);

}  // namespace palpate
