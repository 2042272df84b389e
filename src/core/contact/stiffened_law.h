#pragma once

#include "palpate/contact/soft_contact.h"

/// The contact law of tissue with ContactLaw::strain_stiffening above 0, derived from the law without it.
namespace palpate {

/// soft_contact_force() of such tissue. The tangent stiffness is limited to `max_N_per_mm`: from there on the
/// force is linear in the depth.
SoftContactForce stiffened_force(const ContactLaw& tissue, double depth_mm, double radius_mm,
                                 double max_N_per_mm);
/// tangential_coefficients() of such tissue.
TangentialCoefficients stiffened_lateral(const ContactLaw& tissue, double force_N, double radius_mm,
                                         double max_N_per_mm);
/// complementary_mJ() of such tissue.
double stiffened_complementary_mJ(const ContactLaw& tissue, double force_N, double radius_mm,
                                  double max_N_per_mm);

}  // namespace palpate
