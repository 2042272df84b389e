#include "contact/stiffened_law.h"

#include <algorithm>
#include <cmath>

#include "contact/sphere_law.h"
#include "palpate/base/cube_root.h"
#include "palpate/contact/strain_stiffening.h"

namespace palpate {
namespace {

constexpr int kMaxInversionSteps = 60;
constexpr double kSameDepth = 1e-12;

class StiffenedLaw {
 public:
  StiffenedLaw(const ContactLaw& tissue, double radius_mm, double max_N_per_mm)
      : base_(tissue),
        stiffening_(tissue.strain_stiffening),
        radius_mm_(radius_mm),
        max_N_per_mm_(std::min(max_N_per_mm, 1 / kSoftTissueSettings.min_compliance_mm_per_N)) {
    base_.strain_stiffening = 0;
  }

  /// State at a depth.
  struct State {
    double depth_mm = 0;
    SoftContactForce base;
    StiffenedContact contact;
    double more_N = 0;   ///< Force beyond that at depth_mm, where the law has become linear
    double more_mm = 0;  ///< Depth beyond depth_mm there

    double force_N() const { return contact.factor * base.force_N + more_N; }
    double tangent_N_per_mm() const {
      return contact.factor * base.tangent_N_per_mm + contact.per_mJ * base.force_N * base.force_N;
    }
    double stored_mJ() const {
      return contact.stored_mJ + (contact.factor * base.force_N + 0.5 * more_N) * more_mm;
    }
  };

  State at_depth(double depth_mm) const {
    State state = without_limit(depth_mm);
    if (is_within(state)) return state;
    state = limit_below(depth_mm);
    state.more_mm = depth_mm - state.depth_mm;
    state.more_N = state.more_mm * limited_N_per_mm(state);
    return state;
  }

  State at_force(double force_N) const {
    if (!(force_N > 0)) return {};
    // upper bound of the depth, from that on a half-space without stiffening
    const double load = 0.75 * force_N / base_.modulus_N_per_mm2;
    double low = 0, high = cube_root(load * load / std::max(radius_mm_, kSoftTissueSettings.min_radius_mm));
    State state = without_limit(high);
    for (int n = 0; n < kMaxInversionSteps && state.force_N() < force_N; ++n) {
      low = high;
      high *= 2;
      state = without_limit(high);
    }
    for (int n = 0; n < kMaxInversionSteps; ++n) {
      const double off_N = state.force_N() - force_N;
      (off_N > 0 ? high : low) = state.depth_mm;
      double next = state.depth_mm - off_N / state.tangent_N_per_mm();
      if (!(next > low && next < high)) next = 0.5 * (low + high);
      if (std::abs(next - state.depth_mm) <= kSameDepth * high) break;
      state = without_limit(next);
    }
    if (is_within(state)) return state;
    state = limit_below(state.depth_mm);
    state.more_N = std::max(0.0, force_N - state.force_N());
    state.more_mm = state.more_N / limited_N_per_mm(state);
    return state;
  }

  double limited_N_per_mm(const State& state) const {
    return std::min(state.tangent_N_per_mm(), max_N_per_mm_);
  }

  // Beyond the limit, where the force is linear in the depth, its derivative along the surface is that at the
  // limit.
  TangentialCoefficients lateral(const State& state) const {
    const double f = state.base.force_N, s = cube_root(f), factor = state.contact.factor;
    const SphereLaw law(base_, radius_mm_);
    const double by_energy = state.contact.per_mJ * f * state.more_mm;
    const double by_depth_N = factor * state.base.tangent_N_per_mm * state.more_mm;
    TangentialCoefficients lateral = tangential_coefficients(base_, f, radius_mm_);
    lateral.of_compliance_N2 =
        (factor + by_energy) * lateral.of_compliance_N2 + by_depth_N * law.per_surroundings_N(s);
    lateral.of_stiffening_N3 =
        (factor + by_energy) * lateral.of_stiffening_N3 + by_depth_N * law.per_stiffening_N2(s);
    return lateral;
  }

 private:
  State without_limit(double depth_mm) const {
    State state{depth_mm, soft_contact_force(base_, depth_mm, radius_mm_), {}};
    state.contact = stiffened_contact(stiffening_, state.base.stored_mJ, base_.modulus_N_per_mm2, radius_mm_);
    return state;
  }
  bool is_within(const State& state) const { return state.tangent_N_per_mm() <= max_N_per_mm_; }
  // deepest state within the limit, given a depth that exceeds it
  State limit_below(double depth_mm) const {
    double low = 0, high = depth_mm;
    for (int n = 0; n < kMaxInversionSteps && high - low > kSameDepth * depth_mm; ++n) {
      const double midpoint = 0.5 * (low + high);
      (is_within(without_limit(midpoint)) ? low : high) = midpoint;
    }
    return without_limit(low);
  }

  ContactLaw base_;
  double stiffening_, radius_mm_, max_N_per_mm_;
};

}  // namespace

SoftContactForce stiffened_force(const ContactLaw& tissue, double depth_mm, double radius_mm,
                                 double max_N_per_mm) {
  if (!(depth_mm > 0)) return {};
  const StiffenedLaw law(tissue, radius_mm, max_N_per_mm);
  const auto state = law.at_depth(depth_mm);
  const TangentialCoefficients lateral = law.lateral(state);
  return {state.force_N(), law.limited_N_per_mm(state), state.stored_mJ(),
          tissue.gradient_per_N * lateral.of_compliance_N2 -
              tissue.stiffening_gradient * lateral.of_stiffening_N3};
}

TangentialCoefficients stiffened_lateral(const ContactLaw& tissue, double force_N, double radius_mm,
                                         double max_N_per_mm) {
  const StiffenedLaw law(tissue, radius_mm, max_N_per_mm);
  return law.lateral(law.at_force(force_N));
}

double stiffened_complementary_mJ(const ContactLaw& tissue, double force_N, double radius_mm,
                                  double max_N_per_mm) {
  if (!(force_N > 0)) return 0;
  const auto state = StiffenedLaw(tissue, radius_mm, max_N_per_mm).at_force(force_N);
  return force_N * (state.depth_mm + state.more_mm) - state.stored_mJ();
}

}  // namespace palpate
