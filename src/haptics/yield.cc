#include "palpate/haptics/yield.h"

#include <algorithm>
#include <cmath>

#include "palpate/base/cube_root.h"
#include "palpate/base/hash.h"

namespace palpate {
namespace {

constexpr int kMostRootSteps = 40;
constexpr double kSameRoot = 1e-13;

// the s in 0 ... most_s at which (b s + k) s2 is the depth; that grows all the way there
double root_of_depth(double b, double k, double depth_mm, double most_s) {
  double low = 0, high = most_s;
  double s = std::sqrt(depth_mm / k);
  if (b > 0) s = std::min(s, cube_root(depth_mm / b));
  s = std::min(s, most_s);
  for (int n = 0; n < kMostRootSteps; ++n) {
    const double off_mm = (b * s + k) * s * s - depth_mm;
    (off_mm > 0 ? high : low) = s;
    const double slope = (3 * b * s + 2 * k) * s;
    double next = slope > 0 ? s - off_mm / slope : low;
    if (!(next >= low && next <= high)) next = 0.5 * (low + high);
    if (std::abs(next - s) <= kSameRoot * s) return next;
    s = next;
  }
  return s;
}

}  // namespace

std::uint64_t YieldFrame::hash() const {
  std::uint64_t hash = kHashSeed;
  hash_word(hash, number);
  for (const YieldSpot& one : spot) {
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, one.at[axis]);
      hash_double(hash, one.slope_per_N[axis]);
    }
    for (const double value : {one.compliance_mm_per_N, one.modulus_N_per_mm2, one.patch_radius_mm})
      hash_double(hash, value);
    one.relaxed.hash_into(hash);
  }
  return hash_finish(hash);
}

void YieldState::hash_into(std::uint64_t& hash) const {
  hash_word(hash, frame);
  for (const double value : {left_mm_per_N, left_modulus, elapsed_s, beyond_mm_per_N, modulus_N_per_mm2})
    hash_double(hash, value);
}

YieldingTissue feel_yield(std::uint32_t frame, const YieldSpot& spot, const Point<Patient>& at,
                          double modulus_N_per_mm2, double dt_s, YieldState& state) {
  YieldingTissue tissue{0, Vector<Patient>(), modulus_N_per_mm2};
  if (spot.is_known()) {
    const double told = spot.compliance_mm_per_N;
    const double on = told + spot.slope_per_N.dot(at - spot.at);
    const double carried = std::clamp(on, kYieldFeel.least_carried * told, kYieldFeel.most_carried * told);
    tissue.beyond_mm_per_N = spot.beyond_half_space_mm_per_N() + (carried - told);
    if (carried == on) tissue.slope_per_N = spot.slope_per_N;
    tissue.modulus_N_per_mm2 = spot.modulus_N_per_mm2;
  }
  // what is touched anew has nothing that it could differ from
  if (state.modulus_N_per_mm2 == 0) {
    state.left_mm_per_N = state.left_modulus = 0;
  } else if (frame != state.frame) {
    state.left_mm_per_N = state.beyond_mm_per_N - tissue.beyond_mm_per_N;
    state.left_modulus = state.modulus_N_per_mm2 / tissue.modulus_N_per_mm2 - 1;
    state.elapsed_s = 0;
  }
  state.frame = frame;
  state.elapsed_s = std::min(kYieldFeel.blend_s, state.elapsed_s + dt_s);
  const double left = 1 - state.elapsed_s / kYieldFeel.blend_s;
  tissue.beyond_mm_per_N += left * state.left_mm_per_N;
  tissue.modulus_N_per_mm2 *= 1 + left * state.left_modulus;
  state.beyond_mm_per_N = tissue.beyond_mm_per_N;
  state.modulus_N_per_mm2 = tissue.modulus_N_per_mm2;
  return tissue;
}

YieldForce yield_force(const YieldingTissue& tissue, double depth_mm, double radius_mm,
                       double most_N_per_mm) {
  YieldForce force;
  if (!(depth_mm > 0)) return force;
  const double modulus = tissue.modulus_N_per_mm2, b = tissue.beyond_mm_per_N;
  const double radius = std::max(radius_mm, kYieldFeel.least_radius_mm);
  // with s the force's cube root: depth b s3 + k s2, which gives way by b + 2/3 k / s per newton
  const double k = 0.75 / modulus * cube_root(4 * modulus / (3 * radius));
  const double least_give = std::max(1 / most_N_per_mm, kYieldFeel.least_give_mm_per_N);
  const double most_s =
      b < least_give ? 2 * k / (3 * (least_give - b)) : std::numeric_limits<double>::infinity();
  const auto depth_at = [&](double s) { return (b * s + k) * s * s; };
  // F d less the integral of d over F: of b F it leaves a half, of k F^(2/3) two fifths
  const auto stored = [&](double s) { return s * s * s * s * s * (0.5 * b * s + 0.4 * k); };
  if (std::isfinite(most_s) && depth_mm >= depth_at(most_s)) {
    const double first_N = most_s * most_s * most_s, more_mm = depth_mm - depth_at(most_s);
    force.force_N = first_N + more_mm / least_give;
    force.tangent_N_per_mm = 1 / least_give;
    force.stored_mJ = stored(most_s) + (first_N + 0.5 * more_mm / least_give) * more_mm;
    return force;
  }
  const double s = root_of_depth(b, k, depth_mm, most_s);
  force.force_N = s * s * s;
  force.tangent_N_per_mm = s / (b * s + k * (2.0 / 3));
  force.stored_mJ = stored(s);
  return force;
}

double complementary_mJ(const YieldingTissue& tissue, double force_N, double radius_mm,
                        double most_N_per_mm) {
  if (!(force_N > 0)) return 0;
  const double modulus = tissue.modulus_N_per_mm2, b = tissue.beyond_mm_per_N;
  const double radius = std::max(radius_mm, kYieldFeel.least_radius_mm);
  const double k = 0.75 / modulus * cube_root(4 * modulus / (3 * radius));
  const double least_give = std::max(1 / most_N_per_mm, kYieldFeel.least_give_mm_per_N);
  const double most_s =
      b < least_give ? 2 * k / (3 * (least_give - b)) : std::numeric_limits<double>::infinity();
  const double s = std::min(cube_root(force_N), most_s);
  const double more_N = std::max(0.0, force_N - s * s * s);
  return s * s * s * s * s * (0.5 * b * s + 0.6 * k) +
         more_N * ((b * s + k) * s * s + 0.5 * least_give * more_N);
}

}  // namespace palpate
