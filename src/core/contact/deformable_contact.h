#pragma once

#include <span>

#include "palpate/contact/neighbour_tools.h"
#include "palpate/contact/proxy.h"
#include "palpate/contact/relaxation.h"
#include "palpate/contact/soft_contact.h"

/// Contact of the outermost layer with deformable tissue.
namespace palpate {

/// Contacts with deformable tissue, averaged into one sphere pressing at one point. Members `weighted_...`
/// are sums weighted by the contacts' multipliers, which press() divides by `multiplier_mm`.
struct DeformableContact {
  double multiplier_mm = 0;
  double weighted_modulus = 0, weighted_stiffening = 0, weighted_radius_mm2 = 0;
  Vector<Patient> weighted_arm_mm2;  ///< From the tip
  RelaxationFractions weighted_relaxed;

  bool any() const { return multiplier_mm > 0; }
  void add(double multiplier, const ContactSurface& structure, const Vector<Patient>& arm, double radius) {
    multiplier_mm += multiplier;
    weighted_modulus += multiplier * structure.plane_strain_modulus_N_per_mm2;
    weighted_stiffening += multiplier * structure.strain_stiffening;
    weighted_radius_mm2 += multiplier * radius;
    weighted_arm_mm2 += arm * multiplier;
    weighted_relaxed.add(structure.relaxed, multiplier);
  }
};

/// Tool that presses on deformable tissue.
struct PressingTool {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolPart> parts;         ///< Tool parts in the proxy's attitude
  std::span<const ProxyContact> contacts;  ///< Contacts of the layer
  Point<Patient> tip, proxy;
  Vector<Patient> stretched_mm;  ///< Spring vector, tip to proxy
};

/// Force of deformable tissue.
struct DeformableForce {
  SoftContactForce law;  ///< Force, tangent stiffness and energy
  /// Force over the length of the spring vector; `unclamped_secant_N_per_mm` without the device's stiffness
  /// limit.
  double secant_N_per_mm = 0, unclamped_secant_N_per_mm = 0;
  bool relaxed = false;          ///< Whether the relaxation state was advanced by this tick
  TissueContact tissue_contact;  ///< Contact as input of neighbour_effect() for the other tools
};

/// Force of deformable tissue at the depth of the spring vector.
/// @param pressed     has contacts
/// @param compliance  blending state of the elastic solutions, updated
/// @param relaxation  relaxation state, updated if the model has relaxation times
DeformableForce press(const DeformableContact& pressed, const PressingTool& tool, const ProxyOptions& options,
                      ComplianceState& compliance, RelaxationState& relaxation);

}  // namespace palpate
