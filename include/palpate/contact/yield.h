#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "palpate/contact/elastic_constants.h"
#include "palpate/contact/feel.h"
#include "palpate/contact/relaxation.h"
#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"

/// Deformable soft tissue under the tool: contact force at a depth. The elastic solver
/// (palpate/tissue/yield_solver.h) runs 64 times per second in parallel to the servo and publishes a local
/// compliance, from which every tick computes its force (docs/concepts/tissue.md, "In the tick").
namespace palpate {

/// Contact modulus E* = E / (1 - nu^2), N/mm^2 (Hertz 1882).
inline double contact_modulus_N_per_mm2(const ElasticConstants& constants) {
  constexpr double kN_per_mm2_of_kPa = 1e-3;
  return kN_per_mm2_of_kPa * constants.youngs_modulus_kPa /
         (1 - constants.poissons_ratio * constants.poissons_ratio);
}

/// Local compliance of a point on the surface of soft tissue under a circular patch of pressure p ~ sqrt(1 -
/// r^2 / rho^2).
/// Centre of the patch on the undeformed surface, patient frame.
struct LocalCompliance {
  Point<Patient> at;
  /// W: displacement of the patch along its normal per unit force. 0: unknown.
  double compliance_mm_per_N = 0;
  Vector<Patient> slope_per_N;   ///< grad W along the surface; mm/N per mm
  double modulus_N_per_mm2 = 0;  ///< E* = E / (1 - nu^2) of the tissue under the patch; above 0
  double patch_radius_mm = 0;    ///< rho; above 0
  /// Neo-Hookean solution: the force F1 at which it was computed, and the coefficient C of its difference in
  /// depth to the linear solution, C F^2; below 0: deeper. finite_N 0: none, the linear solution alone
  /// applies.
  double finite_N = 0;
  double stiffening_mm_per_N2 = 0;
  Vector<Patient> stiffening_slope = {};  ///< grad C along the surface; mm/N^2 per mm
  /// Relaxing fractions of the tissues, weighted by their shares of the displacement.
  RelaxedParts relaxed = {};

  bool is_known() const { return compliance_mm_per_N > 0; }
  bool is_finite() const { return finite_N > 0; }
  /// W minus the compliance of a half-space of modulus E* under that patch, 0.6 / (rho E*) (Hertz; Johnson
  /// 1985, 4.2): the effect of the surroundings, above 0 if they are softer, below 0 if something stiff is
  /// near.
  double beyond_half_space_mm_per_N() const {
    return compliance_mm_per_N - 0.6 / (patch_radius_mm * modulus_N_per_mm2);
  }
};

/// Result of one solver frame: for each device the point that it presses or is about to press.
struct ComplianceFrame {
  std::uint32_t number = 0;  ///< Frame number, from 1. 0: none yet
  std::array<LocalCompliance, kMaxDevices> spot;

  /// Equal for equal frames in every build.
  std::uint64_t hash() const;
};

/// State of the deformable tissue that a device's tool presses.
struct ComplianceState {
  std::uint32_t frame = 0;  ///< Number of the current frame
  /// Difference of the rendered values to those of the current frame when it arrived. It fades out over
  /// YieldFeel::blend_s, so that no frame causes a step.
  double left_mm_per_N = 0, left_mm_per_N2 = 0, left_N = 0;
  /// The same for the modulus, relative to the frame's value; above -1, so that the blended modulus stays
  /// above 0 wherever the tool moves meanwhile.
  double left_modulus = 0;
  /// Time since the current frame arrived, up to YieldFeel::blend_s.
  double elapsed_s = 0;
  // values of the last tick; modulus 0: no deformable tissue was in contact
  double surroundings_mm_per_N = 0, modulus_N_per_mm2 = 0, stiffening_mm_per_N2 = 0, finite_N = 0;

  void hash_into(std::uint64_t& hash) const;
};

/// Parameters of the contact law of a tick.
struct ContactLaw {
  double surroundings_mm_per_N = 0;  ///< LocalCompliance::beyond_half_space_mm_per_N at the contact point
  Vector<Patient> slope_per_N;       ///< grad W
  double modulus_N_per_mm2 = 0;      ///< E*; above 0
  double stiffening_mm_per_N2 = 0;   ///< C, as LocalCompliance::stiffening_mm_per_N2
  Vector<Patient> stiffening_slope = {};  ///< grad C
  double finite_N = 0;  ///< F1: force beyond which the C term continues linearly; above 0 unless C is 0
};

/// Force of a sphere at a depth.
struct YieldForce {
  double force_N = 0;           ///< Normal force
  double tangent_N_per_mm = 0;  ///< dF / d depth
  double stored_mJ = 0;         ///< Work needed to press to that depth
  /// Tangential force that makes the law conservative where the compliance varies along the surface.
  Vector<Patient> tangential_force_N;
};

/// Contact law at the point for which a spot was solved.
/// @param spot  known
ContactLaw tissue_at(const LocalCompliance& spot);
/// Contact law at a point in this tick: the frame's values, extrapolated along the surface by their gradients
/// and blended with those of the previous frame. An elastic half-space if no frame is known.
/// @param frame              number of the newest frame; blending starts when it differs from the one in
///                           `state`
/// @param spot               entry of this device in that frame
/// @param at                 contact point on the undeformed surface
/// @param modulus_N_per_mm2  E* of the tissue there, used unless the frame has a value; above 0
/// @param dt_s               length of the tick
/// @param state              blending state, updated
ContactLaw blend_compliance(std::uint32_t frame, const LocalCompliance& spot, const Point<Patient>& at,
                            double modulus_N_per_mm2, double dt_s, ComplianceState& state);

/// Force of a rigid frictionless sphere at a depth, from
///
///     d = B F + 0.75 F / (a E*) - C F^2,   a = (3 F R / 4 E*)^(1/3)
///
/// with -C F1 (2 F - F1) in place of -C F^2 for F above F1 = finite_N. B = W - 0.6 / (rho E*) is the
/// compliance of the surroundings, the second term the sphere's own Hertz contact. The tangent stiffness is
/// limited to `max_N_per_mm`: from there on the force is linear in the depth. The energy is that of this
/// law. Where W and C vary along the surface, the tangential force F^2 / 2 grad W - F^3 / 3 grad C (for F
/// above F1 the corresponding integral) makes it conservative (docs/concepts/tissue.md). Bounded work;
/// bit-identical in every build.
/// @param depth_mm   penetration of the undeformed surface; not above 0: no force
/// @param radius_mm  radius of the sphere; at least YieldFeel::min_radius_mm is used
YieldForce yield_force(const ContactLaw& tissue, double depth_mm, double radius_mm,
                       double max_N_per_mm = std::numeric_limits<double>::infinity());

/// Decrease of that law's energy along the surface at constant force: of_compliance_N2 times grad W minus
/// of_stiffening_N3 times grad C is the tangential force.
struct TangentialCoefficients {
  double of_compliance_N2 = 0, of_stiffening_N3 = 0;
};
/// Coefficients of the tangential force at a normal force.
TangentialCoefficients yield_aside(const ContactLaw& tissue, double force_N);

/// Complementary energy of that law: the integral of the depth over the force, 0 ... force_N; mJ. The stored
/// energy is force times depth minus this.
double complementary_mJ(const ContactLaw& tissue, double force_N, double radius_mm,
                        double max_N_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
