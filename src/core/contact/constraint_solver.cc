#include "contact/constraint_solver.h"

#include <algorithm>
#include <array>

namespace palpate {
namespace {

// friction coefficients of a constraint; on a common surface, averaged over the owners of the contact point
const Friction& friction_of(std::size_t constraint, const ContactProblem& problem, PairFriction& coefficients,
                            OwnerCache& owners) {
  const ContactPair& pair = problem.constraints.pair(constraint);
  const std::size_t index = problem.pairs.index_of(pair);
  if (const Friction* known = coefficients.find(index)) return *known;
  const int step = problem.constraints.step(constraint);
  const Vector<Patient>& normal = problem.constraints.half_space(constraint).normal;
  const Point<Patient> at = problem.proxy + (pair.offset_mm(step) - normal * pair.radius_mm(step));
  Friction friction;
  const OwnerFractions fractions = owners.at(problem.surfaces, pair.index, at);
  for (const OwnerFraction& fraction : fractions.all()) {
    const ContactSurface& structure = problem.surfaces[static_cast<std::size_t>(fraction.structure)];
    friction.static_coefficient += fraction.fraction * structure.static_friction;
    friction.kinetic_coefficient += fraction.fraction * structure.friction;
  }
  return coefficients.store(index, friction);
}

// component of a displacement along all active constraints: in a plane, along an edge, or zero in a corner
Vector<Patient> tangential(const Vector<Patient>& displacement, const ClosestPoint& nearest,
                           const ContactConstraints& constraints) {
  if (nearest.count == 3) return {};
  const Vector<Patient>& first = constraints.half_space(static_cast<std::size_t>(nearest.active[0])).normal;
  if (nearest.count == 1) return displacement - first * first.dot(displacement);
  const Vector<Patient>& second = constraints.half_space(static_cast<std::size_t>(nearest.active[1])).normal;
  const Vector<Patient> edge = first.cross(second).normalized();
  return edge * edge.dot(displacement);
}

// Applies the friction cone to the frictionless goal of a solution with at least one active constraint. The
// radius of the cone at this depth is the coefficient, averaged by multiplier, times the depth. A sliding
// proxy sticks within the kinetic radius; a sticking one is released beyond the static radius.
void apply_friction(const ContactProblem& problem, PairFriction& coefficients, OwnerCache& owners,
                    Solution& solution) {
  const ClosestPoint& nearest = solution.nearest;
  double static_coefficient = 0, kinetic_coefficient = 0, multiplier_sum_mm = 0;
  for (int n = 0; n < nearest.count; ++n) {
    const double multiplier_mm = nearest.multiplier_mm[static_cast<std::size_t>(n)];
    const auto constraint = static_cast<std::size_t>(nearest.active[static_cast<std::size_t>(n)]);
    const Friction& friction = friction_of(constraint, problem, coefficients, owners);
    static_coefficient += multiplier_mm * friction.static_coefficient;
    kinetic_coefficient += multiplier_mm * friction.kinetic_coefficient;
    multiplier_sum_mm += multiplier_mm;
  }
  // with one constraint the depth equals the multiplier; in a corner it is less than the sum of multipliers
  const double depth_mm = (nearest.point - problem.tip).norm();
  const Vector<Patient> to_anchor_mm =
      tangential(solution.friction.anchor - nearest.point, nearest, problem.constraints);
  const double behind_mm = to_anchor_mm.norm();
  const bool was_sticking = solution.friction.sticking;
  bool& sticking = solution.friction.sticking;
  sticking =
      behind_mm <= (was_sticking ? static_coefficient : kinetic_coefficient) / multiplier_sum_mm * depth_mm;
  if (was_sticking && !sticking)
    solution.released_mm = (static_coefficient - kinetic_coefficient) / multiplier_sum_mm * depth_mm;
  solution.goal =
      sticking
          ? nearest.point + to_anchor_mm
          : nearest.point + to_anchor_mm * (kinetic_coefficient / multiplier_sum_mm * depth_mm / behind_mm);
}

}  // namespace

std::optional<Solution> solve_constraints(const ContactProblem& problem, const FrictionState& before,
                                          PairFriction& coefficients, OwnerCache& owners) {
  std::optional<Solution> result;
  const auto nearest = closest_point(problem.tip, problem.constraints.half_spaces());
  if (!nearest) return result;
  Solution& solution = result.emplace();
  solution.nearest = *nearest;
  solution.goal = nearest->point;
  solution.friction = before;
  if (nearest->count == 0) solution.friction.anchored = false;
  if (nearest->count == 0 || !problem.friction)
    solution.friction.sticking = false;
  else
    apply_friction(problem, coefficients, owners, solution);
  return result;
}

void add_contact(const PairSet& pairs, const ContactOrigin& origin, const Vector<Patient>& normal,
                 double multiplier_mm, ProxyLayer& layer, ContactOrigins& origins) {
  if (layer.contact_count == static_cast<int>(kMaxContacts)) return;
  const auto n = static_cast<std::size_t>(layer.contact_count++);
  const ContactPair& pair = pairs[origin.pair];
  layer.contacts[n] = {pair.index, pair.part, pair.axis_fraction(origin.step), normal, multiplier_mm};
  origins.make(n, origin);
}

void store_contacts(const ClosestPoint& nearest, const PairSet& pairs, const ContactConstraints& constraints,
                    ProxyLayer& layer, ContactOrigins& origins) {
  layer.contact_count = 0;
  for (int n = 0; n < nearest.count; ++n) {
    const HalfSpace& active = constraints.half_space(static_cast<std::size_t>(nearest.active[n]));
    // linear in the clearance, so that a constraint takes over load without a step: 1 at contact, 0 from
    // load_sharing_mm on
    std::array<double, kMaxHalfSpaces> weight{};
    double all = 0;
    for (std::size_t c = 0; c < constraints.count(); ++c) {
      const HalfSpace& other = constraints.half_space(c);
      const double clearance_mm = other.clearance(nearest.point);
      if (other.normal.dot(active.normal) < kProxySettings.min_parallel_cosine ||
          clearance_mm >= kProxySettings.load_sharing_mm)
        continue;
      all += weight[c] = 1 - std::max(0.0, clearance_mm) / kProxySettings.load_sharing_mm;
    }
    for (std::size_t c = 0; c < constraints.count(); ++c)
      if (weight[c] > 0)
        add_contact(pairs, {pairs.index_of(constraints.pair(c)), constraints.step(c)},
                    constraints.half_space(c).normal,
                    nearest.multiplier_mm[static_cast<std::size_t>(n)] * weight[c] / all, layer, origins);
  }
}

}  // namespace palpate
