#include "contact/sphere_law.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "palpate/base/cube_root.h"
#include "palpate/contact/contact_settings.h"

namespace palpate {
namespace {

constexpr int kMaxRootSteps = 60, kScannedSteps = 32;
/// Relative step after which one more step of Newton's method would change nothing.
constexpr double kNewtonConverged = 1e-6;
constexpr double kSameRoot = 1e-13;
/// Upper limit of the fraction by which the C term reduces the compliance at F1. At least half of the
/// compliance remains at F1 and above it.
constexpr double kMaxStiffened = 0.5;

// Ratio P of a sphere's depth in a half-space to that of a paraboloid under the same force, 1 / P, and dP/du.
// u: Hertz's contact radius in sphere radii. For large u the contact ends at the equator, and the depth grows
// in proportion to the force.
struct SphereFactor {
  double factor, inverse, slope;
};
SphereFactor sphere_factor(double u) {
  constexpr double kOne = -0.13542403, kTwo = 0.08917277, kThree = 0.0472556 * 2 / 3, kTwoUnder = 0.0472556;
  const double over = 1 + u * (kOne + u * (kTwo + kThree * u)), under = 1 + u * (kOne + kTwoUnder * u);
  // one division for both reciprocals
  const double both = 1 / (over * under), per_under = over * both, factor = over * per_under;
  const double over_slope = kOne + u * (2 * kTwo + 3 * kThree * u), under_slope = kOne + 2 * kTwoUnder * u;
  return {factor, under * under * both, (over_slope - factor * under_slope) * per_under};
}

// Gauss-Jacobi rule on 0 ... 1 with the weight x^4: Hertz's depth over the force is k s^2 times 3 s^2
constexpr std::array kNodes{0.31213549284701714, 0.5789156595623226, 0.81289151661622439,
                            0.96272399764110239};
constexpr std::array kWeights{0.0025163516466441683, 0.029169382162443865, 0.087067712063774838,
                              0.081246554127137119};

}  // namespace

double stiffening_depth_mm(double stiffening_mm_per_N2, double reference_force_N, double force_N) {
  if (force_N <= reference_force_N) return stiffening_mm_per_N2 * force_N * force_N;
  const double s = cube_root(force_N), first_s = cube_root(reference_force_N);
  return stiffening_mm_per_N2 * reference_force_N * first_s * first_s * (6 * s - 5 * first_s);
}

SphereLaw::SphereLaw(const ContactLaw& tissue, double radius_mm)
    : layer_(LayerFactor::under_sphere(tissue.poissons_ratio)),
      b_(tissue.surroundings_mm_per_N),
      c_(tissue.stiffening_mm_per_N2),
      reference_N_(tissue.reference_force_N),
      reference_s_(reference_N_ > 0 ? cube_root(reference_N_) : 0) {
  const double modulus = tissue.modulus_N_per_mm2,
               radius = std::max(radius_mm, kSoftTissueSettings.min_radius_mm);
  const double root = cube_root(4 * modulus / (3 * radius));
  k_ = 0.75 / modulus * root;
  kappa_ = 1 / (radius * root);
  base_ = b_ < 0 ? -b_ / k_ : 0;
  if (!(c_ > 0 && reference_s_ > 0)) return;
  const double largest = 0.5 * kMaxStiffened * elastic_compliance_mm_per_N(reference_s_) / reference_N_;
  if (c_ <= largest) return;
  c_ = largest;
  is_clamped_ = true;
  // derivative of the clamped C with respect to B; the step's error is of third order
  constexpr double kStep = 1e-4;
  const double per_N = (elastic_per_surroundings_N((1 + kStep) * reference_s_) -
                        elastic_per_surroundings_N((1 - kStep) * reference_s_)) /
                       (6 * kStep * reference_N_);
  c_per_b_ = 0.5 * kMaxStiffened * per_N / reference_N_;
}

SphereLaw::Depth SphereLaw::elastic(double s) const {
  const double u = kappa_ * s;
  const auto [p, per_p, p_slope] = sphere_factor(u);
  const double half_space_mm = k_ * s * s * p, per_s = k_ * s * (2 * p + u * p_slope);
  if (b_ >= 0) return {half_space_mm + b_ * s * s * s, per_s + 3 * b_ * s * s};
  const double e = base_ * s * per_p;
  const auto [h, h_slope] = layer_.at(e);
  return {half_space_mm * h, per_s * h + k_ * s * p * h_slope * e * (1 - u * p_slope * per_p)};
}

SphereLaw::Depth SphereLaw::at(double s) const {
  Depth depth = elastic(s);
  if (c_ == 0) return depth;
  const double force_N = s * s * s;
  if (force_N <= reference_N_) {
    depth.mm -= c_ * force_N * force_N;
    depth.per_s -= 6 * c_ * force_N * s * s;
  } else {
    const double first = c_ * reference_N_ * reference_s_ * reference_s_;
    depth.mm -= first * (6 * s - 5 * reference_s_);
    depth.per_s -= 6 * first;
  }
  return depth;
}

double SphereLaw::s_at_depth(double depth_mm) const {
  double s = std::sqrt(depth_mm / k_);
  if (b_ > 0) {
    s = std::min(s, cube_root(depth_mm / b_));
  } else if (b_ < 0) {
    // with H = 1 / (1 + e)
    const double base = base_ * depth_mm;
    s = (base + std::sqrt(base * base + 4 * k_ * depth_mm)) / (2 * k_);
  }
  double low = 0, high = std::numeric_limits<double>::infinity();
  for (int n = 0; n < kMaxRootSteps; ++n) {
    const Depth here = at(s);
    const double off_mm = here.mm - depth_mm;
    (off_mm > 0 ? high : low) = s;
    double next = s - off_mm / here.per_s;
    if (!(next >= low && next <= high)) next = high <= 2 * s ? 0.5 * (low + high) : 2 * s;
    if (std::abs(next - s) <= kNewtonConverged * s) return next;
    s = next;
  }
  return s;
}

double SphereLaw::first_s_below_compliance(double end, double min_compliance_mm_per_N) const {
  constexpr double kNever = std::numeric_limits<double>::infinity();
  // lower bound of the compliance on 0 ... end
  if (elastic_compliance_mm_per_N(end) * (c_ > 0 ? 1 - kMaxStiffened : 1) >= min_compliance_mm_per_N)
    return kNever;
  const auto excess = [&](double s) { return at(s).per_s - 3 * s * s * min_compliance_mm_per_N; };
  double low = 0, high = end;
  // The compliance decreases monotonically up to F1 if C > 0, and beyond F1 if C < 0; on these intervals it
  // suffices to evaluate the end.
  const double kink = std::min(reference_s_, end);
  const auto first_below = [&](double from, double to, int steps) {
    for (int n = 1; n <= steps && to > from; ++n) {
      low = from + (to - from) * (n - 1) / steps;
      high = n == steps ? to : from + (to - from) * n / steps;
      if (excess(high) < 0) return true;
    }
    return false;
  };
  if (c_ == 0 ? !first_below(0, end, 1)
              : !first_below(0, kink, c_ > 0 ? 1 : kScannedSteps) &&
                    !first_below(kink, end, c_ > 0 ? kScannedSteps : 1))
    return kNever;
  // regula falsi with halved weights (Illinois); per s it is above 0 at 0
  const auto per_s = [&](double s) { return s > 0 ? excess(s) / s : 2 * k_; };
  double above = per_s(low), below = per_s(high);
  for (int n = 0, side = 0; n < kMaxRootSteps && high - low > kSameRoot * high; ++n) {
    const double s = (low * below - high * above) / (below - above), here = per_s(s);
    if (here >= 0) {
      low = s;
      above = here;
      if (side > 0) below *= 0.5;
      side = 1;
    } else {
      high = s;
      below = here;
      if (side < 0) above *= 0.5;
      side = -1;
    }
    if (here == 0) break;
  }
  return low;
}

SphereLaw::Integrals SphereLaw::integrals(double s) const {
  const double force_N = s * s * s;
  Integrals sum{0, 0, 0};
  for (std::size_t n = 0; n < kNodes.size(); ++n) {
    const double t = s * kNodes[n];
    const auto [p, per_p, p_slope] = sphere_factor(kappa_ * t);
    if (b_ >= 0) {
      sum.depth_mJ += kWeights[n] * p;
    } else {
      const auto [h, h_slope] = layer_.at(base_ * t * per_p);
      sum.depth_mJ += kWeights[n] * p * h;
      sum.of_surroundings_N2 -= kWeights[n] * kNodes[n] * h_slope;
    }
  }
  sum.depth_mJ *= 3 * k_ * force_N * s * s;
  sum.of_surroundings_N2 *= 3 * force_N * force_N;
  if (b_ >= 0) {
    sum.of_surroundings_N2 = 0.5 * force_N * force_N;
    sum.depth_mJ += b_ * sum.of_surroundings_N2;
  }
  if (force_N <= reference_N_) {
    sum.of_stiffening_N3 = force_N * force_N * force_N / 3;
  } else if (reference_N_ > 0) {
    const double first_4 = reference_N_ * reference_s_, s_4 = force_N * s;
    sum.of_stiffening_N3 = reference_N_ * reference_N_ * reference_N_ / 3 +
                           reference_N_ * reference_s_ * reference_s_ *
                               (4.5 * (s_4 - first_4) - 5 * reference_s_ * (force_N - reference_N_));
  }
  sum.depth_mJ -= c_ * sum.of_stiffening_N3;
  if (is_clamped_) {
    sum.of_surroundings_N2 -= c_per_b_ * sum.of_stiffening_N3;
    sum.of_stiffening_N3 = 0;
  }
  return sum;
}

double SphereLaw::elastic_per_surroundings_N(double s) const {
  if (b_ >= 0) return s * s * s;
  return -layer_.at(base_ * s * sphere_factor(kappa_ * s).inverse).slope * s * s * s;
}

double SphereLaw::per_surroundings_N(double s) const {
  const double elastic = elastic_per_surroundings_N(s);
  return is_clamped_ ? elastic - c_per_b_ * per_c_N2(s) : elastic;
}

double SphereLaw::per_stiffening_N2(double s) const {
  return is_clamped_ ? 0 : per_c_N2(s);
}

double SphereLaw::per_c_N2(double s) const {
  const double force_N = s * s * s;
  if (force_N <= reference_N_) return force_N * force_N;
  return reference_N_ * reference_s_ * reference_s_ * (6 * s - 5 * reference_s_);
}

}  // namespace palpate
