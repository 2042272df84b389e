#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate/geometry/geometry.h"

/// Stress relaxation of soft tissue under a constant strain: quasi-linear viscoelasticity (Fung 1993, 7.6) by
/// a Prony series. For the choices see docs/decisions/archive/0040-relaxation.md.
namespace palpate {

/// Maximum number of terms of a tissue's Prony series.
inline constexpr std::size_t kMaxRelaxationTerms = 2;
/// Maximum number of different time constants of a model's tissues.
inline constexpr std::size_t kMaxRelaxationTimes = 16;
/// Closed range of time constants.
struct RelaxationTimeRange {
  double min_s, max_s;
};
inline constexpr RelaxationTimeRange kRelaxationTimeRange{0.01, 1000};

/// Term of a Prony series.
struct RelaxationTerm {
  double fraction = 0;  ///< Fraction of the modulus that is lost in the long term. 0: no term
  double time_s = 0;    ///< Time constant, after which 1/e of that fraction is left; in kRelaxationTimeRange
  bool operator==(const RelaxationTerm&) const = default;
};

/// Prony series E(t) = E (1 - sum of g_i (1 - exp(-t / tau_i))) of a tissue, where E is the instantaneous
/// modulus. Non-empty terms come first.
struct Relaxation {
  std::array<RelaxationTerm, kMaxRelaxationTerms> term;

  /// Fraction of the modulus that all terms together lose in the long term; below 1.
  double total_fraction() const;
  bool relaxes() const { return term[0].fraction > 0; }
  bool operator==(const Relaxation&) const = default;
};

/// Distinct time constants of a model's tissues, in ascending order.
struct RelaxationTimes {
  std::array<double, kMaxRelaxationTimes> time_s{};
  std::size_t count = 0;  ///< Number of time constants

  bool any() const { return count > 0; }
  /// Adds the time constants of a series.
  /// @returns false if there is no room for them
  bool add(const Relaxation& relaxation);
};

/// Relaxing fraction of the modulus for each time constant of the model; in sum below 1.
struct RelaxationFractions {
  std::array<double, kMaxRelaxationTimes> of_time{};

  /// Adds a tissue's series.
  /// @param times   time constants of the model
  /// @param weight  weight of the tissue
  void add(const Relaxation& relaxation, const RelaxationTimes& times, double weight);
  void add(const RelaxationFractions& other, double weight);
  bool any() const;
  /// Entries of 0 do not change the hash.
  void hash_into(std::uint64_t& hash) const;
};

/// Relaxation state of the tissue that a device's tool presses.
struct RelaxationState {
  /// Instantaneous elastic force at the tool's depth, or at the depth of the dent where that is deeper; N.
  double elastic_N = 0;
  /// Low-pass filtered elastic force for each time constant of the model: a fraction g of the modulus loses
  /// the force g times this.
  std::array<double, kMaxRelaxationTimes> lagging_N{};
  RelaxationFractions fractions;  ///< Fractions used in the last tick, or those of the dent
  Point<Patient> at;              ///< Last contact point on the undeformed surface
  bool presses = false;           ///< Whether the tool pressed in the last tick

  bool is_active() const { return elastic_N > 0; }
  void hash_into(std::uint64_t& hash) const;
};

/// Exponential decay for x = time over time constant: exp(-x), and its mean (1 - exp(-x)) / x over the
/// interval, to 1e-14. Bit-identical on every machine, which std::exp does not guarantee.
/// @param x  at least 0
struct Decay {
  double remaining = 1, mean = 1;
};
Decay decay(double x);

/// Contact of a tool with relaxing tissue.
struct RelaxingContact {
  RelaxationFractions fractions;  ///< Relaxing fractions of the tissue
  Point<Patient> at;              ///< Contact point on the undeformed surface
  double dent_radius_mm = 1;      ///< Radius of the dent that the tool makes; above 0
  double blend_s = 1;             ///< Time over which new fractions replace those rendered before; above 0
};

/// Advances the relaxation by one tick. Returns the viscoelastic force for an elastic one,
///
///     F = F_e - sum of g_i p_i,   tau_i dp_i/dt = F_e - p_i,
///
/// exact for a linear change of F_e in the tick, at any tick length (Taylor, Pister & Goudreau 1970; Simo &
/// Hughes 1998, 10.3). A tool that withdraws faster than the tissue recovers leaves a dent: the force is then
/// 0, and F_e is that of the dent, which recovers like free tissue. No energy is generated
/// (docs/decisions/archive/0040-relaxation.md). At a new contact point the dent is reduced linearly with the
/// distance from the last one, to none at its radius. Bounded work; bit-identical in every build.
/// @param elastic_N  elastic force at the tool's depth; at least 0
/// @param contact    null: no contact with deformable tissue, elastic_N is 0
/// @returns force in N, 0 ... elastic_N
double advance_relaxation(const RelaxationTimes& times, double elastic_N, const RelaxingContact* contact,
                          double dt_s, RelaxationState& state);

}  // namespace palpate
