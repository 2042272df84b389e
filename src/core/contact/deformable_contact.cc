#include "contact/deformable_contact.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "contact/footprint.h"

namespace palpate {
namespace {

// Footprint of a tool with several parts, or of a capsule lying along tissue, which may have fewer contacts
// than places that press. The depths are offset so that the deepest equals the spring's length.
// @param base_per_mm  as for footprint_of
Footprint footprint_under(const DeformableContact& pressed, const PressingTool& tool, double base_per_mm) {
  const double per_multiplier = 1 / pressed.multiplier_mm, depth_mm = tool.stretched_mm.norm();
  const Footprint one{depth_mm, pressed.weighted_radius_mm2 * per_multiplier, 0, 1,
                      pressed.weighted_arm_mm2 * per_multiplier};
  if ((tool.parts.size() == 1 && tool.parts[0].axis_mm == Vector<Patient>()) || !(depth_mm > 0)) return one;
  std::array<int, kMaxContacts> touched;
  std::size_t count = 0;
  for (const ProxyContact& contact : tool.contacts) {
    const auto known = std::span(touched).first(count);
    if (std::ranges::find(known, contact.surface) == known.end()) touched[count++] = contact.surface;
  }
  std::array<FootprintPoint, kMaxFootprintPoints> points;
  std::size_t found =
      find_press_points(tool.surfaces, std::span(touched).first(count), tool.parts, tool.tip, points);
  double deepest_mm = 0;
  for (const FootprintPoint& point : std::span(points).first(found))
    deepest_mm = std::max(deepest_mm, point.depth_mm);
  const auto shallow = std::remove_if(points.begin(), points.begin() + found, [&](FootprintPoint& point) {
    point.depth_mm += depth_mm - deepest_mm;
    return !(point.depth_mm > 0);
  });
  found = static_cast<std::size_t>(shallow - points.begin());
  if (found <= 1) return one;
  return footprint_of(std::span(points).first(found), tool.stretched_mm * (1 / depth_mm), base_per_mm);
}

// viscoelastic correction of an elastic force and of its stored energy
// (docs/decisions/archive/0040-relaxation.md)
void relax(const ContactLaw& tissue, const RelaxingContact& contact, const Footprint& foot,
           double max_N_per_mm, const ProxyOptions& options, RelaxationState& state, DeformableForce& force) {
  const double elastic_N = force.law.force_N;
  const double force_N =
      advance_relaxation(*options.relaxation_times, elastic_N, &contact, options.dt_s, state);
  force.relaxed = true;
  double stored_mJ =
      force_N * foot.depth_mm - complementary_mJ(tissue, state.elastic_N, foot.radius_mm, max_N_per_mm);
  TangentialCoefficients lateral = tangential_coefficients(tissue, elastic_N, foot.radius_mm, max_N_per_mm);
  for (std::size_t n = 0; n < options.relaxation_times->count; ++n) {
    const double fraction = state.fractions.of_time[n], lagging_N = state.lagging_N[n];
    if (!(fraction > 0)) continue;
    stored_mJ += fraction * complementary_mJ(tissue, lagging_N, foot.radius_mm, max_N_per_mm);
    const TangentialCoefficients lagging =
        tangential_coefficients(tissue, lagging_N, foot.radius_mm, max_N_per_mm);
    lateral.of_compliance_N2 -= fraction * lagging.of_compliance_N2;
    lateral.of_stiffening_N3 -= fraction * lagging.of_stiffening_N3;
  }
  force.law.force_N = force_N;
  force.law.stored_mJ = std::max(0.0, stored_mJ);
  // a contact with a force that rounds to 0 also has a secant stiffness of 0
  const double remaining_fraction = elastic_N > 0 ? force_N / elastic_N : 1;
  force.secant_N_per_mm *= remaining_fraction;
  force.unclamped_secant_N_per_mm *= remaining_fraction;
  force.law.tangential_force_N = tissue.gradient_per_N * std::max(0.0, lateral.of_compliance_N2) -
                                 tissue.stiffening_gradient * std::max(0.0, lateral.of_stiffening_N3);
}

}  // namespace

DeformableForce press(const DeformableContact& pressed, const PressingTool& tool, const ProxyOptions& options,
                      ComplianceState& compliance, RelaxationState& relaxation) {
  // values of the last tick: those of this one are looked up where the footprint lies
  const double base_per_mm = std::max(0.0, -compliance.surroundings_mm_per_N * compliance.modulus_N_per_mm2);
  Footprint foot = footprint_under(pressed, tool, base_per_mm);
  const double length_mm = tool.stretched_mm.norm();
  const ComplianceFrame* const frame = options.compliance;
  const LocalCompliance local =
      frame != nullptr ? frame->local_compliance[options.device] : LocalCompliance{};
  const double per_multiplier = 1 / pressed.multiplier_mm;
  const Point<Patient> at = tool.proxy + foot.arm_mm;
  ContactLaw tissue = blend_compliance(frame != nullptr ? frame->number : 0, local, at,
                                       pressed.weighted_modulus * per_multiplier, options.dt_s, compliance,
                                       pressed.weighted_stiffening * per_multiplier);
  tissue.surroundings_mm_per_N += foot.interaction_per_mm / tissue.modulus_N_per_mm2;
  DeformableForce force;
  TissueContact& own = force.tissue_contact;
  own.modulus_N_per_mm2 = tissue.modulus_N_per_mm2;
  own.base_per_mm = base_per_mm;
  own.radius_mm = std::max(pressed.weighted_radius_mm2 * per_multiplier, kSoftTissueSettings.min_radius_mm);
  own.at = at;
  own.outward = tool.stretched_mm.normalized();
  own.surface = std::ranges::max_element(tool.contacts, {}, &ProxyContact::multiplier_mm)->surface;
  const NeighbourEffect others = neighbour_effect(options.tissue_contacts, options.device, own);
  own.displaced_mm = others.displaced_mm;
  foot.depth_mm -= others.displaced_mm;
  if (!(foot.depth_mm > 0)) return force;
  const double max_N_per_mm = options.max_stiffness_N_per_mm / foot.stiffness_ratio;
  force.law = soft_contact_force(tissue, foot.depth_mm, foot.radius_mm, max_N_per_mm);
  constexpr double kRounding = 1e-9;
  const bool limited = force.law.tangent_N_per_mm >= (1 - kRounding) * max_N_per_mm;
  force.law.tangent_N_per_mm *= foot.stiffness_ratio;
  force.secant_N_per_mm = force.law.force_N / length_mm;
  force.unclamped_secant_N_per_mm =
      limited ? soft_contact_force(tissue, foot.depth_mm, foot.radius_mm).force_N / length_mm
              : force.secant_N_per_mm;
  const auto finish = [&] {
    own.force_N = force.law.force_N;
    own.tangent_N_per_mm = force.law.tangent_N_per_mm;
    force.law.tangential_force_N += others.force_per_N * own.force_N;
    return force;
  };
  if (options.relaxation_times == nullptr) return finish();
  RelaxingContact contact{local.relaxed, at,
                          kSoftTissueSettings.dent_radii * pressed.weighted_radius_mm2 * per_multiplier,
                          kSoftTissueSettings.blend_s};
  if (!local.is_known()) {
    contact.fractions = {};
    contact.fractions.add(pressed.weighted_relaxed, per_multiplier);
  }
  relax(tissue, contact, foot, max_N_per_mm, options, relaxation, force);
  return finish();
}

}  // namespace palpate
