#include "palpate/contact/yield.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/cube_root.h"
#include "palpate/base/hash.h"

namespace palpate {
namespace {

constexpr int kMaxRootSteps = 40;
constexpr double kSameRoot = 1e-13;

/// Depth at the force F = s^3: b F + k F^(2/3) - c F^2, and -c first_N (2 F - first_N) instead of the last
/// term for F above first_N.
struct DepthLaw {
  double b, k, c, first_N;

  double at(double s) const {
    const double force_N = s * s * s;
    return (b * s + k) * s * s -
           c * (force_N <= first_N ? force_N * force_N : first_N * (2 * force_N - first_N));
  }
  // reduction of the compliance dd/dF by the c term
  double less(double s) const { return 2 * c * std::min(s * s * s, first_N); }
  double per_s(double s) const { return (3 * b * s + 2 * k) * s - 3 * less(s) * s * s; }
  // dd/dF, times s
  double per_N(double s) const { return b * s + k * (2.0 / 3) - less(s) * s; }
  // stored energy: F d minus the integral of d over F; of b F one half remains, of k F^(2/3) two fifths, of c
  // F^2 two thirds
  double stored(double s) const {
    const double force_N = s * s * s;
    return s * s * s * s * s * (0.5 * b * s + 0.4 * k) -
           c * (force_N <= first_N ? force_N * force_N * force_N * (2.0 / 3)
                                   : first_N * (force_N * force_N - first_N * first_N * (1.0 / 3)));
  }
  // largest s at which the compliance is at least `least`; infinite: everywhere
  double max_s(double least) const;

 private:
  static double straight_most_s(double b, double k, double least) {
    return b < least ? 2 * k / (3 * (least - b)) : std::numeric_limits<double>::infinity();
  }
};

double DepthLaw::max_s(double least) const {
  if (c == 0) return straight_most_s(b, k, least);
  // the compliance decreases monotonically beyond first_N
  const double beyond = straight_most_s(b - 2 * c * first_N, k, least);
  // first root of (b - least) s + 2/3 k - 2 c s^4 below it
  const double more = b - least;
  double s = straight_most_s(b, k, least);
  if (c > 0) {
    // concave: Newton's method converges from above the root, where c s^4 exceeds each of the other terms
    double end = std::sqrt(std::sqrt(2 * k / (3 * c)));
    if (more > 0) end = std::max(end, cube_root(more / c));
    s = std::min(s, end);
  } else {
    // convex: Newton's method converges from 0 to the first root, if there is one
    if (more >= 0) return beyond;
    const double lowest = cube_root(more / (8 * c));
    if (more * lowest * 0.75 + k * (2.0 / 3) >= 0) return beyond;
  }
  for (int n = 0; n < kMaxRootSteps; ++n) {
    const double left = more * s + k * (2.0 / 3) - 2 * c * (s * s) * (s * s);
    const double slope = more - 8 * c * (s * s * s);
    const double next = s - left / slope;
    if (!(slope < 0) || !(next > 0) || std::abs(next - s) <= kSameRoot * s) break;
    s = next;
  }
  return s * s * s <= first_N ? s : beyond;
}

DepthLaw law_of(const ContactLaw& tissue, double radius_mm) {
  const double modulus = tissue.modulus_N_per_mm2;
  const double radius = std::max(radius_mm, kYieldFeel.min_radius_mm);
  return {tissue.surroundings_mm_per_N, 0.75 / modulus * cube_root(4 * modulus / (3 * radius)),
          tissue.stiffening_mm_per_N2, tissue.finite_N};
}

// the s in 0 ... max_s with a given depth; on that interval the depth increases with a compliance of at
// least `least`
double root_of_depth(const DepthLaw& law, double depth_mm, double max_s, double least) {
  const double b = law.b, k = law.k;
  double low = 0, high = law.c == 0 ? max_s : std::min(max_s, cube_root(depth_mm / least));
  double s = std::sqrt(depth_mm / k);
  if (b > 0) s = std::min(s, cube_root(depth_mm / b));
  s = std::min(s, high);
  for (int n = 0; n < kMaxRootSteps; ++n) {
    const double off_mm = law.at(s) - depth_mm;
    (off_mm > 0 ? high : low) = s;
    const double slope = law.per_s(s);
    double next = slope > 0 ? s - off_mm / slope : low;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    if (std::abs(next - s) <= kSameRoot * s) return next;
    s = next;
  }
  return s;
}

}  // namespace

std::uint64_t ComplianceFrame::hash() const {
  std::uint64_t hash = kHashSeed;
  hash_word(hash, number);
  for (const LocalCompliance& one : spot) {
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, one.at[axis]);
      hash_double(hash, one.slope_per_N[axis]);
    }
    for (const double value : {one.compliance_mm_per_N, one.modulus_N_per_mm2, one.patch_radius_mm})
      hash_double(hash, value);
    one.relaxed.hash_into(hash);
    // the linear law adds nothing to the hash
    if (!one.is_finite()) continue;
    hash_double(hash, one.finite_N);
    hash_double(hash, one.stiffening_mm_per_N2);
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, one.stiffening_slope[axis]);
  }
  return hash_finish(hash);
}

void ComplianceState::hash_into(std::uint64_t& hash) const {
  hash_word(hash, frame);
  for (const double value :
       {left_mm_per_N, left_modulus, elapsed_s, surroundings_mm_per_N, modulus_N_per_mm2})
    hash_double(hash, value);
  // the linear law adds nothing to the hash
  if (finite_N == 0 && left_N == 0) return;
  for (const double value : {left_mm_per_N2, left_N, stiffening_mm_per_N2, finite_N})
    hash_double(hash, value);
}

ContactLaw tissue_at(const LocalCompliance& spot) {
  ContactLaw tissue{spot.beyond_half_space_mm_per_N(), spot.slope_per_N, spot.modulus_N_per_mm2};
  if (!spot.is_finite()) return tissue;
  tissue.stiffening_mm_per_N2 = spot.stiffening_mm_per_N2;
  tissue.stiffening_slope = spot.stiffening_slope;
  tissue.finite_N = spot.finite_N;
  return tissue;
}

ContactLaw blend_compliance(std::uint32_t frame, const LocalCompliance& spot, const Point<Patient>& at,
                            double modulus_N_per_mm2, double dt_s, ComplianceState& state) {
  ContactLaw tissue;
  tissue.modulus_N_per_mm2 = modulus_N_per_mm2;
  if (spot.is_known()) {
    const double told = spot.compliance_mm_per_N;
    const double on = told + spot.slope_per_N.dot(at - spot.at);
    const double carried =
        std::clamp(on, kYieldFeel.min_extrapolation * told, kYieldFeel.max_extrapolation * told);
    tissue.surroundings_mm_per_N = spot.beyond_half_space_mm_per_N() + (carried - told);
    if (carried == on) tissue.slope_per_N = spot.slope_per_N;
    tissue.modulus_N_per_mm2 = spot.modulus_N_per_mm2;
    if (spot.is_finite()) {
      const double c = spot.stiffening_mm_per_N2, there = c + spot.stiffening_slope.dot(at - spot.at);
      const double most = kYieldFeel.max_stiffening * told / spot.finite_N;
      tissue.stiffening_mm_per_N2 = std::clamp(there, std::min(-most, c), std::max(most, c));
      tissue.finite_N = spot.finite_N;
      if (tissue.stiffening_mm_per_N2 == there) tissue.stiffening_slope = spot.stiffening_slope;
    }
  }
  // a new contact has no previous values to blend with
  if (state.modulus_N_per_mm2 == 0) {
    state.left_mm_per_N = state.left_modulus = state.left_mm_per_N2 = state.left_N = 0;
  } else if (frame != state.frame) {
    state.left_mm_per_N = state.surroundings_mm_per_N - tissue.surroundings_mm_per_N;
    state.left_modulus = state.modulus_N_per_mm2 / tissue.modulus_N_per_mm2 - 1;
    state.left_mm_per_N2 = state.stiffening_mm_per_N2 - tissue.stiffening_mm_per_N2;
    state.left_N = state.finite_N - tissue.finite_N;
    state.elapsed_s = 0;
  }
  state.frame = frame;
  state.elapsed_s = std::min(kYieldFeel.blend_s, state.elapsed_s + dt_s);
  const double left = 1 - state.elapsed_s / kYieldFeel.blend_s;
  tissue.surroundings_mm_per_N += left * state.left_mm_per_N;
  tissue.modulus_N_per_mm2 *= 1 + left * state.left_modulus;
  tissue.stiffening_mm_per_N2 += left * state.left_mm_per_N2;
  tissue.finite_N += left * state.left_N;
  state.surroundings_mm_per_N = tissue.surroundings_mm_per_N;
  state.modulus_N_per_mm2 = tissue.modulus_N_per_mm2;
  state.stiffening_mm_per_N2 = tissue.stiffening_mm_per_N2;
  state.finite_N = tissue.finite_N;
  return tissue;
}

YieldForce yield_force(const ContactLaw& tissue, double depth_mm, double radius_mm, double max_N_per_mm) {
  YieldForce force;
  if (!(depth_mm > 0)) return force;
  const DepthLaw law = law_of(tissue, radius_mm);
  const double min_give = std::max(1 / max_N_per_mm, kYieldFeel.min_compliance_mm_per_N);
  const double max_s = law.max_s(min_give);
  if (std::isfinite(max_s) && depth_mm >= law.at(max_s)) {
    const double first_N = max_s * max_s * max_s, more_mm = depth_mm - law.at(max_s);
    force.force_N = first_N + more_mm / min_give;
    force.tangent_N_per_mm = 1 / min_give;
    force.stored_mJ = law.stored(max_s) + (first_N + 0.5 * more_mm / min_give) * more_mm;
  } else {
    const double s = root_of_depth(law, depth_mm, max_s, min_give);
    force.force_N = s * s * s;
    force.tangent_N_per_mm = s / law.per_N(s);
    force.stored_mJ = law.stored(s);
  }
  const TangentialCoefficients aside = yield_aside(tissue, force.force_N);
  force.tangential_force_N =
      tissue.slope_per_N * aside.of_compliance_N2 - tissue.stiffening_slope * aside.of_stiffening_N3;
  return force;
}

TangentialCoefficients yield_aside(const ContactLaw& tissue, double force_N) {
  const double squared = force_N * force_N, first_N = tissue.finite_N;
  return {0.5 * squared, force_N <= first_N
                             ? squared * force_N * (1.0 / 3)
                             : first_N * (squared - first_N * (force_N - first_N * (1.0 / 3)))};
}

double complementary_mJ(const ContactLaw& tissue, double force_N, double radius_mm, double max_N_per_mm) {
  if (!(force_N > 0)) return 0;
  const DepthLaw law = law_of(tissue, radius_mm);
  const double min_give = std::max(1 / max_N_per_mm, kYieldFeel.min_compliance_mm_per_N);
  const double max_s = law.max_s(min_give);
  const double s = std::min(cube_root(force_N), max_s);
  const double more_N = std::max(0.0, force_N - s * s * s);
  return s * s * s * s * s * (0.5 * law.b * s + 0.6 * law.k) -
         law.c * yield_aside(tissue, s * s * s).of_stiffening_N3 +
         more_N * (law.at(s) + 0.5 * min_give * more_N);
}

}  // namespace palpate
