#pragma once

#include <cstdint>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "palpate/base/contact_properties.h"
#include "palpate/contact/elastic_constants.h"
#include "palpate/contact/relaxation.h"
#include "palpate/volume/volume.h"

/// Tissues: properties of groups of labels, and the constitutive laws of soft tissue.
namespace palpate {

/// Effect of a burr on a structure.
enum class Protection : std::uint8_t {
  kNone,   ///< The structure is cut like any other
  kAlarm,  ///< The structure is cut, and the damage is reported, e.g. to a trainee
  kBlock,  ///< The burr cannot enter the structure or remove any of it
};

/// Constitutive law of soft tissue under a tool.
enum class TissueLaw : std::uint8_t {
  kLayers,   ///< Rigid geometry: each structure resists by its own spring stiffness
  kElastic,  ///< Tissues with ElasticConstants are linear elastic bodies (docs/concepts/tissue.md)
  /// Tissues with ElasticConstants are neo-Hookean bodies where the solver finds such a solution, otherwise
  /// linear elastic.
  kNeoHookean,
  /// Forces as in kLayers; tissues with ElasticConstants move visibly as a chain mail
  /// (palpate/tissue/chain_mail.h).
  kChainMail,
  /// As kNeoHookean; tissues with ElasticConstants::stiffening also stiffen exponentially with strain.
  kExponential,
};
/// Whether bodies under this law are solved with large strains.
constexpr bool is_hyperelastic(TissueLaw law) {
  return law == TissueLaw::kNeoHookean || law == TissueLaw::kExponential;
}
/// Whether tissues with ElasticConstants deform elastically under this law.
constexpr bool is_elastic(TissueLaw law) {
  return law == TissueLaw::kElastic || is_hyperelastic(law);
}
/// Whether tissues with ElasticConstants move visibly under this law.
constexpr bool is_moving(TissueLaw law) {
  return law != TissueLaw::kLayers;
}

/// Mechanical and visual properties of a tissue that stay the same while it is rendered.
struct FixedProperties {
  bool touchable = true;  ///< Whether it can be touched; false: displayed only
  /// Proxy: normal force above which the tool punctures it; infinite: never.
  double puncture_N = std::numeric_limits<double>::infinity();
  bool stays_open = false;  ///< Whether a puncture leaves a permanent hole, passed again without force
  /// Direct methods: viscous coefficient of the pseudo-friction.
  double friction_damping_N_s_per_mm = 0.005;
  /// Direct methods: limit of the tangential force of the preset (as published)
  double friction_max_N = 0.5;
  /// Specific cutting energy: work of a burr's motor per volume removed, mJ/mm^3; above 0. The default is
  /// that of cortical bone under a burr (docs/decisions/0029-removal.md).
  double cutting_energy_mJ_per_mm3 = 100;
  Protection protection = Protection::kNone;  ///< Protection from burrs; applies only to touchable tissue
  /// Elastic constants for the elastic laws; ignored by kLayers. Empty: rigid (bone, a tooth, an implant),
  /// and soft tissue adheres to it.
  std::optional<ElasticConstants> elastic;
  /// Stress relaxation under the elastic laws; `elastic` has the instantaneous constants.
  Relaxation relaxation;
  double opacity = 1.0;  ///< Opacity in rendered images, 0 ... 1
};

/// All properties of a tissue, as set in a scene.
struct TissueProperties : ContactProperties, FixedProperties {};

/// A group of labels with common properties.
struct Tissue : TissueProperties {
  std::string name;
  Rgb colour;
  std::vector<int> rests_on;  ///< Indices of tissues that support this one
};

}  // namespace palpate
