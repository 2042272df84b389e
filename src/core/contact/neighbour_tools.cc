#include "palpate/contact/neighbour_tools.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "contact/footprint.h"
#include "palpate/base/hash.h"

namespace palpate {
namespace {

/// Limit of the mutual compliance of two tools as a fraction of the geometric mean of their own, 1 / tangent.
/// Below 1 the stiffness matrix of both is positive definite, and the iteration over the ticks, in which each
/// tool meets the other's last force, converges.
constexpr double kMaxMutual = 0.8;

}  // namespace

void TissueContact::hash_into(std::uint64_t& hash) const {
  for (const double value :
       {force_N, tangent_N_per_mm, displaced_mm, modulus_N_per_mm2, base_per_mm, radius_mm})
    hash_double(hash, value);
  for (int axis = 0; axis < 3; ++axis) {
    hash_double(hash, at[axis]);
    hash_double(hash, outward[axis]);
  }
  hash_word(hash, static_cast<std::uint64_t>(surface));
}

NeighbourEffect neighbour_effect(std::span<const TissueContact> tissue_contacts, std::size_t device,
                                 const TissueContact& own) {
  NeighbourEffect effect;
  for (std::size_t d = 0; d < tissue_contacts.size(); ++d) {
    const TissueContact& other = tissue_contacts[d];
    if (d == device || !(other.force_N > 0) || !own.is_known() || other.surface != own.surface) continue;
    const double aligned = other.outward.dot(own.outward);
    const Vector<Patient> away = own.at - other.at;
    const double lateral_mm = away.norm();
    if (!(aligned > 0) || !(lateral_mm > 0)) continue;
    const double radius_mm = std::min(own.radius_mm, other.radius_mm);
    const double base_per_mm = 0.5 * (own.base_per_mm + other.base_per_mm);
    const double per_mm = pair_interaction_per_mm(lateral_mm, radius_mm, base_per_mm) - base_per_mm;
    if (!(per_mm > 0)) continue;
    const double of_modulus = 0.5 * aligned * (1 / own.modulus_N_per_mm2 + 1 / other.modulus_N_per_mm2);
    const double mutual_mm_per_N = per_mm * of_modulus;
    const double stiffness_N_per_mm =
        std::sqrt(tissue_contacts[device].tangent_N_per_mm * other.tangent_N_per_mm);
    const double limited_mm_per_N = std::min(mutual_mm_per_N, kMaxMutual / stiffness_N_per_mm);
    effect.displaced_mm += limited_mm_per_N * other.force_N;
    if (limited_mm_per_N < mutual_mm_per_N) continue;
    // derivative of per_mm with respect to the distance
    const double slope_per_mm2 =
        (lateral_mm < radius_mm ? 1 / (radius_mm * radius_mm) : -1 / (lateral_mm * lateral_mm)) /
            std::numbers::pi +
        0.25 * std::numbers::pi * base_per_mm * base_per_mm;
    const Vector<Patient> along = away - own.outward * away.dot(own.outward);
    effect.force_per_N += along * (slope_per_mm2 * of_modulus * other.force_N / lateral_mm);
  }
  return effect;
}

}  // namespace palpate
