#include "palpate/contact/bonded_layer.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace palpate {
namespace {

/// Mean displacement of a half-space under a patch of radius rho is this times F / (rho E*) (Johnson 1985,
/// 4.2).
constexpr double kHalfSpacePatch = 0.6;
/// Upper bound of the root in surroundings_of_patch(): thinner layers count as rigid.
constexpr double kMaxPatchRatio = 1e3;
constexpr int kMaxPatchSteps = 60;
constexpr double kSamePatch = 1e-12;

template <std::size_t n>
double polynomial(const std::array<double, n>& coefficients, double x) {
  double sum = 0;
  for (const double one : coefficients) sum = sum * x + one;
  return sum;
}

// ratio of E* to the modulus of a confined layer: 0 if incompressible, 1 if nu is 0
double compressibility(double nu) {
  return (1 - 2 * nu) / ((1 - nu) * (1 - nu));
}

}  // namespace

double layer_base_mm_per_N(double thickness_mm, double modulus_N_per_mm2, double poissons_ratio) {
  constexpr std::array kBase{2.5528065473768769, -1.0676232389865707, 0.5014198988427687,
                             0.051039329761902966, 0.38580810508775204};
  return -polynomial(kBase, poissons_ratio) / (thickness_mm * modulus_N_per_mm2);
}

LayerFactor LayerFactor::under_sphere(double poissons_ratio) {
  const double m = compressibility(poissons_ratio);
  return {1.06189937, 0.52665319, polynomial(std::array{-0.39190111, 1.52257178, -2.10150723, 0.51588981}, m),
          polynomial(std::array{2.18253217, -0.83960926, -0.85574682, 1.37004219}, m)};
}

LayerFactor LayerFactor::under_patch(double poissons_ratio) {
  const double m = compressibility(poissons_ratio);
  return {0.99603523, 0.76703199, polynomial(std::array{1.06304969, -2.24557543, 1.03969783, 1.34669912}, m),
          polynomial(std::array{-0.35633918, 0.33679608, 0.92104915, -0.05657895}, m)};
}

PatchSurroundings surroundings_of_patch(double compliance_mm_per_N, double rho_mm, double modulus_N_per_mm2,
                                        double poissons_ratio) {
  const double half_space = kHalfSpacePatch / (rho_mm * modulus_N_per_mm2);
  if (compliance_mm_per_N >= half_space) return {compliance_mm_per_N - half_space, 1};
  const LayerFactor patch = LayerFactor::under_patch(poissons_ratio);
  const double ratio = compliance_mm_per_N / half_space;
  // the factor falls monotonically from 1
  double low = 0, high = kMaxPatchRatio;
  double e = std::min(1 / ratio - 1, high);
  for (int n = 0; n < kMaxPatchSteps; ++n) {
    const auto [factor, slope] = patch.at(e);
    (factor > ratio ? low : high) = e;
    double next = e - (factor - ratio) / slope;
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - e) <= kSamePatch * (1 + e)) break;
    e = next;
  }
  return {-e * half_space, -1 / patch.at(e).slope};
}

double patch_compliance_mm_per_N(double surroundings_mm_per_N, double rho_mm, double modulus_N_per_mm2,
                                 double poissons_ratio) {
  const double half_space = kHalfSpacePatch / (rho_mm * modulus_N_per_mm2);
  if (surroundings_mm_per_N >= 0) return half_space + surroundings_mm_per_N;
  return half_space * LayerFactor::under_patch(poissons_ratio).at(-surroundings_mm_per_N / half_space).factor;
}

}  // namespace palpate
