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
SphereLaw::Integrals integrals_to(const SphereLaw& law, double s, double force_N, double min_mm_per_N) {
  SphereLaw::Integrals sum = law.integrals(s);
  const double more_N = force_N - s * s * s;
  if (!(more_N > 0)) return sum;
  sum.depth_mJ += more_N * (law.at(s).mm + 0.5 * min_mm_per_N * more_N);
  sum.of_surroundings_N2 += more_N * law.per_surroundings_N(s);
  sum.of_stiffening_N3 += more_N * law.per_stiffening_N2(s);
  return sum;
}

// the same for a force
SphereLaw::Integrals integrals_of(const ContactLaw& law, double force_N, double radius_mm,
                                  double max_N_per_mm) {
  if (!(force_N > 0)) return {0, 0, 0};
  const SphereLaw sphere_law(law, radius_mm);
  const double min_mm_per_N = min_compliance_mm_per_N(max_N_per_mm), s = cube_root(force_N);
  return integrals_to(sphere_law, std::min(s, sphere_law.first_s_below_compliance(s, min_mm_per_N)), force_N,
                      min_mm_per_N);
}

}  // namespace

std::uint64_t ComplianceFrame::hash() const {
  std::uint64_t hash = kHashSeed;
  hash_word(hash, number);
  for (const LocalCompliance& one : local_compliance) {
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

ContactLaw contact_law_of(const LocalCompliance& local) {
  ContactLaw law{local.surroundings_mm_per_N, local.gradient_per_N * local.surroundings_per_compliance,
                 local.modulus_N_per_mm2};
  law.poissons_ratio = local.poissons_ratio;
  law.strain_stiffening = local.strain_stiffening;
  if (!local.has_neo_hookean()) return law;
  law.stiffening_mm_per_N2 = local.stiffening_mm_per_N2;
  law.stiffening_gradient = local.stiffening_gradient;
  law.reference_force_N = local.reference_force_N;
  return law;
}

ContactLaw blend_compliance(std::uint32_t frame, const LocalCompliance& local, const Point<Patient>& at,
                            double modulus_N_per_mm2, double dt_s, ComplianceState& state,
                            double strain_stiffening) {
  ContactLaw law;
  law.modulus_N_per_mm2 = modulus_N_per_mm2;
  law.strain_stiffening = local.is_known() ? local.strain_stiffening : strain_stiffening;
  if (local.is_known()) {
    const double solved_mm_per_N = local.compliance_mm_per_N;
    const double extrapolated_mm_per_N = solved_mm_per_N + local.gradient_per_N.dot(at - local.at);
    const double clamped_mm_per_N =
        std::clamp(extrapolated_mm_per_N, kSoftTissueSettings.min_extrapolation * solved_mm_per_N,
                   kSoftTissueSettings.max_extrapolation * solved_mm_per_N);
    const double per_compliance = local.surroundings_per_compliance;
    law.surroundings_mm_per_N =
        local.surroundings_mm_per_N + per_compliance * (clamped_mm_per_N - solved_mm_per_N);
    if (clamped_mm_per_N == extrapolated_mm_per_N) law.gradient_per_N = local.gradient_per_N * per_compliance;
    law.modulus_N_per_mm2 = local.modulus_N_per_mm2;
    law.poissons_ratio = local.poissons_ratio;
    if (local.has_neo_hookean()) {
      const double solved = local.stiffening_mm_per_N2,
                   extrapolated = solved + local.stiffening_gradient.dot(at - local.at);
      const double largest = kSoftTissueSettings.max_stiffening * solved_mm_per_N / local.reference_force_N;
      law.stiffening_mm_per_N2 =
          std::clamp(extrapolated, std::min(-largest, solved), std::max(largest, solved));
      law.reference_force_N = local.reference_force_N;
      if (law.stiffening_mm_per_N2 == extrapolated) law.stiffening_gradient = local.stiffening_gradient;
    }
  }
  // a new contact has no previous values to blend with
  if (state.modulus_N_per_mm2 == 0) {
    state.surroundings_offset_mm_per_N = state.modulus_offset = state.stiffening_offset_mm_per_N2 =
        state.reference_force_offset_N = 0;
    state.poissons_ratio_offset = state.strain_stiffening_offset = 0;
  } else if (frame != state.frame) {
    state.surroundings_offset_mm_per_N = state.surroundings_mm_per_N - law.surroundings_mm_per_N;
    state.modulus_offset = state.modulus_N_per_mm2 / law.modulus_N_per_mm2 - 1;
    state.stiffening_offset_mm_per_N2 = state.stiffening_mm_per_N2 - law.stiffening_mm_per_N2;
    state.reference_force_offset_N = state.reference_force_N - law.reference_force_N;
    state.poissons_ratio_offset = state.poissons_ratio - law.poissons_ratio;
    state.strain_stiffening_offset = state.strain_stiffening - law.strain_stiffening;
    state.elapsed_s = 0;
  }
  state.frame = frame;
  state.elapsed_s = std::min(kSoftTissueSettings.blend_s, state.elapsed_s + dt_s);
  const double offset_weight = 1 - state.elapsed_s / kSoftTissueSettings.blend_s;
  law.surroundings_mm_per_N += offset_weight * state.surroundings_offset_mm_per_N;
  law.modulus_N_per_mm2 *= 1 + offset_weight * state.modulus_offset;
  law.stiffening_mm_per_N2 += offset_weight * state.stiffening_offset_mm_per_N2;
  law.reference_force_N += offset_weight * state.reference_force_offset_N;
  law.poissons_ratio += offset_weight * state.poissons_ratio_offset;
  law.strain_stiffening += offset_weight * state.strain_stiffening_offset;
  state.surroundings_mm_per_N = law.surroundings_mm_per_N;
  state.modulus_N_per_mm2 = law.modulus_N_per_mm2;
  state.stiffening_mm_per_N2 = law.stiffening_mm_per_N2;
  state.reference_force_N = law.reference_force_N;
  state.poissons_ratio = law.poissons_ratio;
  state.strain_stiffening = law.strain_stiffening;
  return law;
}

SoftContactForce soft_contact_force(const ContactLaw& law, double depth_mm, double radius_mm,
                                    double max_N_per_mm) {
  if (law.strain_stiffening > 0) return stiffened_force(law, depth_mm, radius_mm, max_N_per_mm);
  SoftContactForce force;
  if (!(depth_mm > 0)) return force;
  const SphereLaw sphere_law(law, radius_mm);
  const double min_mm_per_N = min_compliance_mm_per_N(max_N_per_mm);
  double s = sphere_law.s_at_depth(depth_mm);
  const double compliance_mm_per_N = sphere_law.compliance_mm_per_N(s);
  // without a C term the compliance is least at the greatest force
  const bool never_limited = law.stiffening_mm_per_N2 == 0 && compliance_mm_per_N >= min_mm_per_N;
  const double limited_s = never_limited ? s : sphere_law.first_s_below_compliance(s, min_mm_per_N);
  if (limited_s < s) {
    s = limited_s;
    force.force_N = s * s * s + std::max(0.0, depth_mm - sphere_law.at(s).mm) / min_mm_per_N;
    force.tangent_N_per_mm = 1 / min_mm_per_N;
  } else {
    force.force_N = s * s * s;
    force.tangent_N_per_mm = 1 / compliance_mm_per_N;
  }
  const auto [depth_mJ, of_surroundings_N2, of_stiffening_N3] =
      integrals_to(sphere_law, s, force.force_N, min_mm_per_N);
  force.stored_mJ = force.force_N * depth_mm - depth_mJ;
  force.tangential_force_N =
      law.gradient_per_N * of_surroundings_N2 - law.stiffening_gradient * of_stiffening_N3;
  return force;
}

TangentialCoefficients tangential_coefficients(const ContactLaw& law, double force_N, double radius_mm,
                                               double max_N_per_mm) {
  if (law.strain_stiffening > 0) return stiffened_lateral(law, force_N, radius_mm, max_N_per_mm);
  const auto sum = integrals_of(law, force_N, radius_mm, max_N_per_mm);
  return {sum.of_surroundings_N2, sum.of_stiffening_N3};
}

double complementary_mJ(const ContactLaw& law, double force_N, double radius_mm, double max_N_per_mm) {
  if (law.strain_stiffening > 0) return stiffened_complementary_mJ(law, force_N, radius_mm, max_N_per_mm);
  return integrals_of(law, force_N, radius_mm, max_N_per_mm).depth_mJ;
}

}  // namespace palpate
