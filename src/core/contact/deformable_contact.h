#pragma once

#include <span>

#include "palpate/contact/proxy.h"
#include "palpate/contact/relaxation.h"
#include "palpate/contact/soft_contact.h"

/// Contact of the outermost layer with deformable tissue.
namespace palpate {

/// Contacts with deformable tissue, averaged into one sphere pressing at one point. Sums are weighted by the
/// contacts' multipliers.
struct DeformableContact {
  double multiplier_mm = 0;
  double modulus = 0, strain_stiffening = 0, radius_mm = 0;
  Vector<Patient> arm_mm;  ///< From the tip
  RelaxationFractions relaxed;

  bool any() const { return multiplier_mm > 0; }
  void add(double multiplier, const ContactSurface& structure, const Vector<Patient>& arm, double radius) {
    multiplier_mm += multiplier;
    modulus += multiplier * structure.plane_strain_modulus_N_per_mm2;
    strain_stiffening += multiplier * structure.strain_stiffening;
    radius_mm += multiplier * radius;
    arm_mm += arm * multiplier;
    relaxed.add(structure.relaxed, multiplier);
  }
};

/// Tool that presses on deformable tissue.
struct PressingTool {
  std::span<const ContactSurface> surfaces;
  std::span<const ToolSphere> spheres;     ///< Tool parts in the proxy's attitude
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
