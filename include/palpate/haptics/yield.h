#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "palpate/device/telemetry.h"
#include "palpate/geometry/geometry.h"
#include "palpate/haptics/elastic_constants.h"
#include "palpate/haptics/feel.h"
#include "palpate/haptics/relaxation.h"

/// Soft tissue under the tool: how much of its depth gives way, and which force that leaves. What is solved
/// 64 times a second beside the servo (palpate/tissue/yield_solver.h) is told as a few numbers, from which
/// every tick makes its own force (docs/concepts/tissue.md, "In the tick").
namespace palpate {

/// E* = E / (1 - nu2), N/mm2: how a body resists what is pressed into it (Hertz 1882).
inline double contact_modulus_N_per_mm2(const ElasticConstants& constants) {
  constexpr double kN_per_mm2_of_kPa = 1e-3;
  return kN_per_mm2_of_kPa * constants.youngs_modulus_kPa /
         (1 - constants.poissons_ratio * constants.poissons_ratio);
}

/// What a place on the surface of soft tissue does under a round patch of pressure, p ~ sqrt(1 - r2 / rho2).
struct YieldSpot {
  Point<Patient> at;
  /// W: what the patch gives way along its normal under 1 N; 0: nothing is known here.
  double compliance_mm_per_N = 0;
  Vector<Patient> slope_per_N;   ///< grad W along the surface, mm/N per mm
  double modulus_N_per_mm2 = 0;  ///< E* = E / (1 - nu2) of the tissue under the patch; above 0
  double patch_radius_mm = 0;    ///< rho; above 0
  /// Of a neo-Hookean solution: the force at which it was found, and C, by which it is less deep there than
  /// the linear one, C F2; below 0: deeper. 0: none was found or asked for, the linear one holds alone.
  double finite_N = 0;
  double stiffening_mm_per_N2 = 0;
  Vector<Patient> stiffening_slope = {};  ///< grad C along the surface, mm/N2 per mm
  RelaxedParts relaxed = {};              ///< of the tissues, each by its part of what gives way

  bool is_known() const { return compliance_mm_per_N > 0; }
  bool is_finite() const { return finite_N > 0; }
  /// W less what a half space of E* gives under that patch, 0.6 / (rho E*) (Hertz; Johnson 1985, 4.2): what
  /// is around, above 0 where it is softer, below where something hard is near.
  double beyond_half_space_mm_per_N() const {
    return compliance_mm_per_N - 0.6 / (patch_radius_mm * modulus_N_per_mm2);
  }
};

/// What was solved at a time: of each device the place that it presses or is about to.
struct YieldFrame {
  std::uint32_t number = 0;  ///< from 1; 0: none yet
  std::array<YieldSpot, kMaxDevices> spot;

  /// Equal for equal frames on every build.
  std::uint64_t hash() const;
};

/// What a hand remembers of the tissue that it presses.
struct YieldState {
  std::uint32_t frame = 0;
  /// What was felt less what the frame says, when it came: it fades out over YieldFeel::blend_s, so that no
  /// frame is felt as a step.
  double left_mm_per_N = 0, left_mm_per_N2 = 0, left_N = 0;
  /// Likewise of the modulus, as a part of what the frame says: above -1, so that it stays above 0 wherever
  /// the tool goes meanwhile.
  double left_modulus = 0;
  double elapsed_s = 0;
  // as they were felt last; modulus 0: nothing that yields was touched
  double beyond_mm_per_N = 0, modulus_N_per_mm2 = 0, stiffening_mm_per_N2 = 0, finite_N = 0;

  void hash_into(std::uint64_t& hash) const;
};

/// What yields under a sphere, as it is felt in a tick.
struct YieldingTissue {
  double beyond_mm_per_N = 0;       ///< YieldSpot::beyond_half_space_mm_per_N at the place that is touched
  Vector<Patient> slope_per_N;      ///< grad W
  double modulus_N_per_mm2 = 0;     ///< E*, above 0
  double stiffening_mm_per_N2 = 0;  ///< C: YieldSpot::stiffening_mm_per_N2
  Vector<Patient> stiffening_slope = {};  ///< grad C
  double finite_N = 0;  ///< beyond it what C gives goes on straight; where C is not 0 above 0
};

/// What a sphere's depth in it makes.
struct YieldForce {
  double force_N = 0;
  double tangent_N_per_mm = 0;  ///< dF / d depth
  double stored_mJ = 0;         ///< the work that pressing so deep takes
  Vector<Patient> aside_N;      ///< along the surface: what keeps that energy where the tissue changes
};

/// The tissue at the place for which a spot was solved, which is known.
YieldingTissue tissue_at(const YieldSpot& spot);
/// The tissue as it is felt at a place in this tick: the frame's, carried along the surface by its slope,
/// with what is left of the frame before. Where no frame is known of, a half space.
/// @param frame    number of the newest; one that `state` has is the same
/// @param spot     of it, this device's
/// @param at       on the surface at rest, where the tool leans
/// @param modulus_N_per_mm2  E* of what lies there, for where no frame says better; above 0
YieldingTissue feel_yield(std::uint32_t frame, const YieldSpot& spot, const Point<Patient>& at,
                          double modulus_N_per_mm2, double dt_s, YieldState& state);

/// The force of a rigid sphere pressed so deep, without friction: of
///
///     d = B F + 0.75 F / (a E*) - C F2,   a = (3 F R / 4 E*)^(1/3)
///
/// and -C F1 (2 F - F1) from F1 = finite_N on, with B = W - 0.6 / (rho E*) from the tissue around and the
/// sphere's own contact by Hertz. It grows no faster with the depth than `most_N_per_mm`: from where it
/// would, it goes on straight. The energy is that of this law; where W and C change along the surface, F2 / 2
/// grad W - F3 / 3 grad C (from F1 on its integral likewise) is the force aside that keeps it
/// (docs/concepts/tissue.md). Bounded work, the same bits on every build.
/// @param depth_mm   of the sphere in the surface at rest; not above 0: no force
/// @param radius_mm  smaller ones count as YieldFeel::least_radius_mm
YieldForce yield_force(const YieldingTissue& tissue, double depth_mm, double radius_mm,
                       double most_N_per_mm = std::numeric_limits<double>::infinity());

/// By how much the energy of that law, kept at its force, falls along the surface: of_compliance_N2 times
/// grad W less of_stiffening_N3 times grad C is the force aside.
struct YieldAside {
  double of_compliance_N2 = 0, of_stiffening_N3 = 0;
};
YieldAside yield_aside(const YieldingTissue& tissue, double force_N);

/// Of the same law the integral of the depth over the force, 0 ... force_N (the complementary energy): what a
/// depth stores is the force times the depth less this.
double complementary_mJ(const YieldingTissue& tissue, double force_N, double radius_mm,
                        double most_N_per_mm = std::numeric_limits<double>::infinity());

}  // namespace palpate
