#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <span>

#include "palpate/contact/contact_settings.h"
#include "palpate/contact/elastic_constants.h"
#include "palpate/contact/relaxation.h"
#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

/// Deformable soft tissue under the tool: contact force at a depth. The elastic solver
/// (palpate/tissue/soft_tissue_solver.h) runs 64 times per second in parallel to the servo and publishes a
/// local compliance, from which every tick computes its force (docs/concepts/tissue.md, "In the tick").
namespace palpate {

/// Contact modulus E* = E / (1 - nu^2), N/mm^2 (Hertz 1882).
inline double contact_modulus_N_per_mm2(const ElasticConstants& constants) {
  constexpr double kN_per_mm2_of_kPa = 1e-3;
  return kN_per_mm2_of_kPa * constants.youngs_modulus_kPa /
         (1 - constants.poissons_ratio * constants.poissons_ratio);
}

/// Local compliance of a point on the surface of soft tissue under a circular patch of pressure p ~ sqrt(1 -
/// r^2 / rho^2).
struct LocalCompliance {
  Point<Patient> at;  ///< Centre of the patch on the undeformed surface
  /// W: displacement of the patch along its normal per unit force. 0: unknown.
  double compliance_mm_per_N = 0;
  Vector<Patient> gradient_per_N;  ///< grad W along the surface; mm/N per mm
  double modulus_N_per_mm2 = 0;    ///< E* = E / (1 - nu^2) of the tissue under the patch; above 0
  double patch_radius_mm = 0;      ///< rho; above 0
  /// Neo-Hookean solution: F1, the force at which it was computed, and C: depth = linear depth - C F^2. C <
  /// 0: the tissue softens. reference_force_N == 0: no neo-Hookean solution; the linear one applies.
  double reference_force_N = 0;
  double stiffening_mm_per_N2 = 0;
  Vector<Patient> stiffening_gradient = {};  ///< grad C along the surface; mm/N^2 per mm
  /// ElasticConstants::stiffening of the tissues, weighted by their shares of the displacement. 0: none, or
  /// the law is not TissueLaw::kExponential.
  double strain_stiffening = 0;
  /// Relaxing fractions of the tissues, weighted by their shares of the displacement.
  RelaxationFractions relaxed = {};

  double poissons_ratio = ElasticConstants{}.poissons_ratio;  ///< nu of the tissue under the patch
  /// B: correction of the depth in a half-space by the surroundings, d = d0(F) + B F, in contacts much
  /// smaller than the thickness of the tissue. Positive if the surroundings are softer than the tissue under
  /// the patch, negative if they are stiffer.
  double surroundings_mm_per_N = 0;
  double surroundings_per_compliance = 1;  ///< dB/dW

  bool is_known() const { return compliance_mm_per_N > 0; }
  bool has_neo_hookean() const { return reference_force_N > 0; }
  /// Sets B and dB/dW from W, rho, E* and nu (surroundings_of_patch).
  void compute_surroundings();
};

/// Result of one solver frame: for each device the local compliance at its current or predicted contact
/// point.
struct ComplianceFrame {
  std::uint32_t number = 0;  ///< Frame number, from 1. 0: none yet
  std::array<LocalCompliance, kMaxDevices> local_compliance;

  /// Equal for equal frames in every build.
  std::uint64_t hash() const;
};

/// State of the deformable tissue that a device's tool presses.
struct ComplianceState {
  std::uint32_t frame = 0;  ///< Number of the current frame
  /// Difference of the rendered values to those of the current frame when it arrived. It fades out over
  /// SoftTissueSettings::blend_s, so that no frame causes a step.
  double surroundings_offset_mm_per_N = 0, stiffening_offset_mm_per_N2 = 0, reference_force_offset_N = 0,
         poissons_ratio_offset = 0, strain_stiffening_offset = 0;
  /// The same for the modulus, relative to the frame's value; above -1, so that the blended modulus stays
  /// above 0 at any position of the tool.
  double modulus_offset = 0;
  /// Time since the current frame arrived, up to SoftTissueSettings::blend_s.
  double elapsed_s = 0;
  // values of the last tick; modulus 0: no deformable tissue was in contact
  double surroundings_mm_per_N = 0, modulus_N_per_mm2 = 0, stiffening_mm_per_N2 = 0, reference_force_N = 0,
         poissons_ratio = 0, strain_stiffening = 0;

  void hash_into(std::uint64_t& hash) const;
};

/// Parameters of the contact law of a tick.
struct ContactLaw {
  double surroundings_mm_per_N = 0;          ///< B, as LocalCompliance::surroundings_mm_per_N
  Vector<Patient> gradient_per_N;            ///< grad B
  double modulus_N_per_mm2 = 0;              ///< E*; above 0
  double stiffening_mm_per_N2 = 0;           ///< C, as LocalCompliance::stiffening_mm_per_N2
  Vector<Patient> stiffening_gradient = {};  ///< grad C
  double reference_force_N = 0;  ///< F1: force up to which the C term is C F^2; above 0 unless C is 0
  double poissons_ratio = ElasticConstants{}.poissons_ratio;  ///< nu
  double strain_stiffening = 0;  ///< Exponent b, at least 0 (strain_stiffening.h)
};

/// Force of a sphere at a depth.
struct SoftContactForce {
  double force_N = 0;           ///< Normal force
  double tangent_N_per_mm = 0;  ///< dF / d depth
  double stored_mJ = 0;         ///< Work needed to press to that depth
  /// Tangential force that makes the law conservative where the compliance varies along the surface.
  Vector<Patient> tangential_force_N;
};

/// Contact law at the point for which the local compliance was solved.
/// @param local  known
ContactLaw contact_law_of(const LocalCompliance& local);
/// Contact law at a point in this tick: the frame's values, extrapolated along the surface by their gradients
/// and blended with those of the previous frame. An elastic half-space if no frame is known.
/// @param frame              number of the newest frame; blending starts when it differs from the one in
///                           `state`
/// @param local              entry of this device in that frame
/// @param at                 contact point on the undeformed surface
/// @param modulus_N_per_mm2  E* of the tissue there, used unless the frame has a value; above 0
/// @param dt_s               length of the tick
/// @param state              blending state, updated
/// @param strain_stiffening  exponent b of the tissue there, used unless the frame is known
ContactLaw blend_compliance(std::uint32_t frame, const LocalCompliance& local, const Point<Patient>& at,
                            double modulus_N_per_mm2, double dt_s, ComplianceState& state,
                            double strain_stiffening = 0);

/// Depth by which the C term reduces a sphere's: C F^2 up to F1. Beyond, its derivative with respect to F
/// falls as F^(-2/3), as slowly as that of the thinnest layer's depth, so that the depth stays monotonic in
/// F.
/// @param reference_force_N  F1
double stiffening_depth_mm(double stiffening_mm_per_N2, double reference_force_N, double force_N);

/// Force of a rigid frictionless sphere at a depth d. d0(F) is the depth in a half-space of E* (Sneddon
/// 1965).
///
///     B >= 0:  d = d0 + B F            surroundings softer than the tissue under the sphere
///     B < 0:   d = d0 H(-B F / d0)     a layer on a rigid base, H from 1 to 0: LayerFactor::under_sphere
///
/// less the C term (stiffening_depth_mm), which is limited to half the compliance dd/dF at F1. So the force
/// increases with the depth at every ratio of contact to thickness. The tangent stiffness is limited to
/// `max_N_per_mm`: from there on the force is linear in the depth. The energy is that of this law. Where B
/// and C vary along the surface, the tangential force (tangential_coefficients) makes it conservative
/// (docs/concepts/tissue.md). Where the tissue stiffens with strain, all of this is multiplied by the factor
/// of stiffened_contact() (strain_stiffening.h), and the limit of the tangent stiffness applies to the
/// product. Bounded work; bit-identical in every build.
/// @param depth_mm   penetration of the undeformed surface; not above 0: no force
/// @param radius_mm  radius of the sphere; at least SoftTissueSettings::min_radius_mm is used
SoftContactForce soft_contact_force(const ContactLaw& law, double depth_mm, double radius_mm,
                                    double max_N_per_mm = std::numeric_limits<double>::infinity());

/// Decrease of that law's energy along the surface at constant depth: of_compliance_N2 times grad B minus
/// of_stiffening_N3 times grad C is the tangential force.
struct TangentialCoefficients {
  double of_compliance_N2 = 0, of_stiffening_N3 = 0;
};
/// Coefficients of the tangential force at a normal force.
TangentialCoefficients tangential_coefficients(const ContactLaw& law, double force_N, double radius_mm,
                                               double max_N_per_mm = std::numeric_limits<double>::infinity());

/// Complementary energy of that law: the integral of the depth over the force, 0 ... force_N; mJ. The stored
/// energy is force times depth minus this.
double complementary_mJ(const ContactLaw& law, double force_N, double radius_mm,
                        double max_N_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
