#include "contact/contact_springs.h"

#include <algorithm>
#include <cmath>

namespace palpate {

Vector<Patient> torque_of(std::span<const ProxyContact> contacts, std::span<const ToolPart> parts,
                          const Vector<Patient>& force_N, double stiffness_N_per_mm) {
  Vector<Patient> torque_Nmm, along_N = force_N;
  double all_mm = 0;
  for (const ProxyContact& contact : contacts) {
    along_N -= contact.normal * (contact.multiplier_mm * stiffness_N_per_mm);
    all_mm += contact.multiplier_mm;
  }
  for (const ProxyContact& contact : contacts) {
    const ToolPart& part = parts[static_cast<std::size_t>(contact.part)];
    torque_Nmm += arm_of(contact, part)
                      .cross(contact.normal * (contact.multiplier_mm * stiffness_N_per_mm) +
                             along_N * (contact.multiplier_mm / all_mm));
  }
  return torque_Nmm;
}

double LayerStiffness::contribution(const ContactSurface& surface, const ContactSurface& structure) const {
  const double own = std::min(structure.stiffness_N_per_mm, max_N_per_mm_);
  const double upper = surface.layer >= structure.layer ? own : std::min(own, surface.upper_N_per_mm);
  // relative tolerance: rounding of the sum must not count as a shortfall
  const bool has_shortfall =
      contributed_N_per_mm_ && *contributed_N_per_mm_ < surface.lower_N_per_mm * (1 - 1e-9);
  return upper - std::min(own, has_shortfall ? *contributed_N_per_mm_ : surface.lower_N_per_mm);
}

ContactSprings::LayerMean ContactSprings::average(const SpringInputs& in, OwnerCache& owners) {
  LayerMean mean;
  const auto contacts = in.contacts();
  for (std::size_t n = 0; n < contacts.size(); ++n) {
    const ProxyContact& contact = contacts[n];
    const ContactSurface& surface = surfaces_[static_cast<std::size_t>(contact.surface)];
    const ToolPart& part = in.parts[static_cast<std::size_t>(contact.part)];
    const Vector<Patient> arm_mm = arm_of(contact, part);
    owners_.make(n, owners.at(surfaces_, contact.surface, in.layer.position + arm_mm));
    mean.multiplier_mm += contact.multiplier_mm;
    for (const OwnerFraction& fraction : owners_[n].all()) {
      const ContactSurface& structure = surfaces_[static_cast<std::size_t>(fraction.structure)];
      const double multiplier_mm = contact.multiplier_mm * fraction.fraction;
      mean.friction += multiplier_mm * (in.layer.sticking ? structure.static_friction : structure.friction);
      if (structure.plane_strain_modulus_N_per_mm2 > 0) {
        mean.pressed.add(multiplier_mm, structure, arm_mm, part.radius_at_mm(contact.axis_fraction));
        continue;
      }
      mean.unclamped_stiffness += multiplier_mm * unclamped_.contribution(surface, structure);
      mean.stiffness += multiplier_mm * clamped_.contribution(surface, structure);
    }
  }
  if (!(mean.multiplier_mm > 0)) return mean;
  mean.stiffness /= mean.multiplier_mm;
  mean.unclamped_stiffness /= mean.multiplier_mm;
  return mean;
}

ProxyForce ContactSprings::add(const SpringInputs& in, OwnerCache& owners, ComplianceState& compliance,
                               RelaxationState& relaxation) {
  const auto contacts = in.contacts();
  const LayerMean mean = average(in, owners);
  const DeformableContact& pressed = mean.pressed;
  ProxyForce force;
  if (!(mean.multiplier_mm > 0)) {
    compliance = {};
    invalidate_outer_layers();
    return force;
  }
  if (pressed.any()) invalidate_outer_layers();
  clamped_.add(mean.stiffness);
  unclamped_.add(mean.unclamped_stiffness);

  // rigid structures
  const Vector<Patient> stretched_mm = (in.layer.position - tip_) * in.layer.stretch_fraction;
  double stiffness = mean.stiffness, unclamped_stiffness = mean.unclamped_stiffness;
  // stiffness of deformable tissue is not limited here: its solution has time constants of its own
  if (!pressed.any())
    stiffness = limit_stiffness(stiffness, in.layer.spring_N_per_mm, stretched_mm, in.slip_N, in.motion);
  force.stored_mJ = 0.5 * stiffness * stretched_mm.squared_norm();
  force.tangent_N_per_mm = stiffness;

  // deformable structures
  if (pressed.any()) {
    const DeformableForce tissue =
        palpate::press(pressed, {surfaces_, in.parts, contacts, tip_, in.layer.position, stretched_mm},
                       options_, compliance, relaxation);
    relaxed_ = relaxed_ || tissue.relaxed;
    const double fraction = pressed.multiplier_mm / mean.multiplier_mm;
    tissue_contact_ = tissue.tissue_contact;
    tissue_contact_.force_N *= fraction;
    stiffness += fraction * tissue.secant_N_per_mm;
    unclamped_stiffness += fraction * tissue.unclamped_secant_N_per_mm;
    force.tangent_N_per_mm += fraction * tissue.law.tangent_N_per_mm;
    force.stored_mJ += fraction * tissue.law.stored_mJ;
    force.force_N = tissue.law.tangential_force_N * fraction;
    force.deformable = true;
  } else {
    compliance = {};
  }
  force.stiffness_N_per_mm = stiffness;
  force.force_N += stretched_mm * stiffness;
  force.torque_Nmm = torque_of(contacts, in.parts, force.force_N, stiffness);

  // totals over the layers
  path_.begin_layer(stretched_mm, stiffness);
  for (std::size_t n = 0; n < contacts.size(); ++n) {
    for (const OwnerFraction& fraction : owners_[n].all())
      path_.add_owner(fraction.structure, fraction.fraction * contacts[n].multiplier_mm / mean.multiplier_mm);
    normals_N_ += contacts[n].normal * (contacts[n].multiplier_mm * stiffness);
  }
  if (in.has_arrived) add_puncture_forces(contacts, unclamped_stiffness);
  friction_N_ += mean.friction * stiffness;
  normal_N_ += mean.multiplier_mm * stiffness;
  return force;
}

void ContactSprings::add_puncture_forces(std::span<const ProxyContact> contacts, double unclamped_stiffness) {
  for (std::size_t n = 0; n < contacts.size(); ++n)
    for (const OwnerFraction& fraction : owners_[n].all())
      if (std::isfinite(surfaces_[static_cast<std::size_t>(fraction.structure)].puncture_N))
        puncture_forces_.add(fraction.structure,
                             contacts[n].multiplier_mm * unclamped_stiffness * fraction.fraction);
}

}  // namespace palpate
