#include "palpate/contact/soft_contact.h"

#include <algorithm>
#include <cmath>

#include "contact/sphere_law.h"
#include "contact/stiffened_law.h"
#include "palpate/base/cube_root.h"
#include "palpate/base/hash.h"

namespace palpate {
namespace {

double min_compliance_mm_per_N(double max_N_per_mm) {
  return std::max(1 / max_N_per_mm, kSoftTissueSettings.min_compliance_mm_per_N);
}

// Integrals of SphereLaw over the force, where the law is linear in the force beyond s.
SphereLaw::Integrals integrals_to(const SphereLaw& law, double s, double force_N,
                                  double min_compliance_ratio) {
  SphereLaw::Integrals sum = law.integrals(s);
  const double more_N = force_N - s * s * s;
  if (!(more_N > 0)) return sum;
  sum.depth_mJ += more_N * (law.at(s).mm + 0.5 * min_compliance_ratio * more_N);
  sum.of_surroundings_N2 += more_N * law.per_surroundings_N(s);
  sum.of_stiffening_N3 += more_N * law.per_stiffening_N2(s);
  return sum;
}

// the same for a force
SphereLaw::Integrals integrals_of(const ContactLaw& tissue, double force_N, double radius_mm,
                                  double max_N_per_mm) {
  if (!(force_N > 0)) return {0, 0, 0};
  const SphereLaw law(tissue, radius_mm);
  const double min_compliance_ratio = min_compliance_mm_per_N(max_N_per_mm), s = cube_root(force_N);
  return integrals_to(law, std::min(s, law.first_limited(s, min_compliance_ratio)), force_N,
                      min_compliance_ratio);
}

}  // namespace

std::uint64_t ComplianceFrame::hash() const {
  std::uint64_t hash = kHashSeed;
  hash_word(hash, number);
  for (const LocalCompliance& one : spot) {
    for (int axis = 0; axis < 3; ++axis) {
      hash_double(hash, one.at[axis]);
      hash_double(hash, one.gradient_per_N[axis]);
    }
    for (const double value :
         {one.compliance_mm_per_N, one.modulus_N_per_mm2, one.patch_radius_mm, one.poissons_ratio,
          one.surroundings_mm_per_N, one.surroundings_per_compliance})
      hash_double(hash, value);
    one.relaxed.hash_into(hash);
    // tissue without stiffening adds nothing to the hash
    if (one.strain_stiffening > 0) hash_double(hash, one.strain_stiffening);
    // the linear law adds nothing to the hash
    if (!one.has_neo_hookean()) continue;
    hash_double(hash, one.reference_force_N);
    hash_double(hash, one.stiffening_mm_per_N2);
    for (int axis = 0; axis < 3; ++axis) hash_double(hash, one.stiffening_gradient[axis]);
  }
  return hash_finish(hash);
}

void LocalCompliance::compute_surroundings() {
  const auto [surroundings, per_compliance] =
      surroundings_of_patch(compliance_mm_per_N, patch_radius_mm, modulus_N_per_mm2, poissons_ratio);
  surroundings_mm_per_N = surroundings;
  surroundings_per_compliance = per_compliance;
}

void ComplianceState::hash_into(std::uint64_t& hash) const {
  hash_word(hash, frame);
  for (const double value : {surroundings_offset_mm_per_N, modulus_offset, poissons_ratio_offset, elapsed_s,
                             surroundings_mm_per_N, modulus_N_per_mm2, poissons_ratio})
    hash_double(hash, value);
  // tissue without stiffening adds nothing to the hash
  if (strain_stiffening != 0 || strain_stiffening_offset != 0)
    for (const double value : {strain_stiffening, strain_stiffening_offset}) hash_double(hash, value);
  // the linear law adds nothing to the hash
  if (reference_force_N == 0 && reference_force_offset_N == 0) return;
  for (const double value :
       {stiffening_offset_mm_per_N2, reference_force_offset_N, stiffening_mm_per_N2, reference_force_N})
    hash_double(hash, value);
}

ContactLaw tissue_at(const LocalCompliance& spot) {
  ContactLaw tissue{spot.surroundings_mm_per_N, spot.gradient_per_N * spot.surroundings_per_compliance,
                    spot.modulus_N_per_mm2};
  tissue.poissons_ratio = spot.poissons_ratio;
  tissue.strain_stiffening = spot.strain_stiffening;
  if (!spot.has_neo_hookean()) return tissue;
  tissue.stiffening_mm_per_N2 = spot.stiffening_mm_per_N2;
  tissue.stiffening_gradient = spot.stiffening_gradient;
  tissue.reference_force_N = spot.reference_force_N;
  return tissue;
}

ContactLaw blend_compliance(std::uint32_t frame, const LocalCompliance& spot, const Point<Patient>& at,
                            double modulus_N_per_mm2, double dt_s, ComplianceState& state,
                            double strain_stiffening) {
  ContactLaw tissue;
  tissue.modulus_N_per_mm2 = modulus_N_per_mm2;
  tissue.strain_stiffening = spot.is_known() ? spot.strain_stiffening : strain_stiffening;
  if (spot.is_known()) {
    const double solved_mm_per_N = spot.compliance_mm_per_N;
    const double on = solved_mm_per_N + spot.gradient_per_N.dot(at - spot.at);
    const double carried = std::clamp(on, kSoftTissueSettings.min_extrapolation * solved_mm_per_N,
                                      kSoftTissueSettings.max_extrapolation * solved_mm_per_N);
    const double per_compliance = spot.surroundings_per_compliance;
    tissue.surroundings_mm_per_N = spot.surroundings_mm_per_N + per_compliance * (carried - solved_mm_per_N);
    if (carried == on) tissue.gradient_per_N = spot.gradient_per_N * per_compliance;
    tissue.modulus_N_per_mm2 = spot.modulus_N_per_mm2;
    tissue.poissons_ratio = spot.poissons_ratio;
    if (spot.has_neo_hookean()) {
      const double c = spot.stiffening_mm_per_N2, there = c + spot.stiffening_gradient.dot(at - spot.at);
      const double largest = kSoftTissueSettings.max_stiffening * solved_mm_per_N / spot.reference_force_N;
      tissue.stiffening_mm_per_N2 = std::clamp(there, std::min(-largest, c), std::max(largest, c));
      tissue.reference_force_N = spot.reference_force_N;
      if (tissue.stiffening_mm_per_N2 == there) tissue.stiffening_gradient = spot.stiffening_gradient;
    }
  }
  // a new contact has no previous values to blend with
  if (state.modulus_N_per_mm2 == 0) {
    state.surroundings_offset_mm_per_N = state.modulus_offset = state.stiffening_offset_mm_per_N2 =
        state.reference_force_offset_N = 0;
    state.poissons_ratio_offset = state.strain_stiffening_offset = 0;
  } else if (frame != state.frame) {
    state.surroundings_offset_mm_per_N = state.surroundings_mm_per_N - tissue.surroundings_mm_per_N;
    state.modulus_offset = state.modulus_N_per_mm2 / tissue.modulus_N_per_mm2 - 1;
    state.stiffening_offset_mm_per_N2 = state.stiffening_mm_per_N2 - tissue.stiffening_mm_per_N2;
    state.reference_force_offset_N = state.reference_force_N - tissue.reference_force_N;
    state.poissons_ratio_offset = state.poissons_ratio - tissue.poissons_ratio;
    state.strain_stiffening_offset = state.strain_stiffening - tissue.strain_stiffening;
    state.elapsed_s = 0;
  }
  state.frame = frame;
  state.elapsed_s = std::min(kSoftTissueSettings.blend_s, state.elapsed_s + dt_s);
  const double left = 1 - state.elapsed_s / kSoftTissueSettings.blend_s;
  tissue.surroundings_mm_per_N += left * state.surroundings_offset_mm_per_N;
  tissue.modulus_N_per_mm2 *= 1 + left * state.modulus_offset;
  tissue.stiffening_mm_per_N2 += left * state.stiffening_offset_mm_per_N2;
  tissue.reference_force_N += left * state.reference_force_offset_N;
  tissue.poissons_ratio += left * state.poissons_ratio_offset;
  tissue.strain_stiffening += left * state.strain_stiffening_offset;
  state.surroundings_mm_per_N = tissue.surroundings_mm_per_N;
  state.modulus_N_per_mm2 = tissue.modulus_N_per_mm2;
  state.stiffening_mm_per_N2 = tissue.stiffening_mm_per_N2;
  state.reference_force_N = tissue.reference_force_N;
  state.poissons_ratio = tissue.poissons_ratio;
  state.strain_stiffening = tissue.strain_stiffening;
  return tissue;
}

SoftContactForce soft_contact_force(const ContactLaw& tissue, double depth_mm, double radius_mm,
                                    double max_N_per_mm) {
  if (tissue.strain_stiffening > 0) return stiffened_force(tissue, depth_mm, radius_mm, max_N_per_mm);
  SoftContactForce force;
  if (!(depth_mm > 0)) return force;
  const SphereLaw law(tissue, radius_mm);
  const double min_compliance_ratio = min_compliance_mm_per_N(max_N_per_mm);
  double s = law.root(depth_mm);
  const double give = law.compliance_mm_per_N(s);
  // without a C term the compliance is least at the greatest force
  const bool never_limited = tissue.stiffening_mm_per_N2 == 0 && give >= min_compliance_ratio;
  const double limited_s = never_limited ? s : law.first_limited(s, min_compliance_ratio);
  if (limited_s < s) {
    s = limited_s;
    force.force_N = s * s * s + std::max(0.0, depth_mm - law.at(s).mm) / min_compliance_ratio;
    force.tangent_N_per_mm = 1 / min_compliance_ratio;
  } else {
    force.force_N = s * s * s;
    force.tangent_N_per_mm = 1 / give;
  }
  const auto [depth_mJ, of_surroundings_N2, of_stiffening_N3] =
      integrals_to(law, s, force.force_N, min_compliance_ratio);
  force.stored_mJ = force.force_N * depth_mm - depth_mJ;
  force.tangential_force_N =
      tissue.gradient_per_N * of_surroundings_N2 - tissue.stiffening_gradient * of_stiffening_N3;
  return force;
}

TangentialCoefficients tangential_coefficients(const ContactLaw& tissue, double force_N, double radius_mm,
                                               double max_N_per_mm) {
  if (tissue.strain_stiffening > 0) return stiffened_lateral(tissue, force_N, radius_mm, max_N_per_mm);
  const auto sum = integrals_of(tissue, force_N, radius_mm, max_N_per_mm);
  return {sum.of_surroundings_N2, sum.of_stiffening_N3};
}

double complementary_mJ(const ContactLaw& tissue, double force_N, double radius_mm, double max_N_per_mm) {
  if (tissue.strain_stiffening > 0)
    return stiffened_complementary_mJ(tissue, force_N, radius_mm, max_N_per_mm);
  return integrals_of(tissue, force_N, radius_mm, max_N_per_mm).depth_mJ;
}

}  // namespace palpate
