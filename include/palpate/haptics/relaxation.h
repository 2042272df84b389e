#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "palpate/geometry/geometry.h"

/// Soft tissue that is pressed and held gives way further, so that its force falls: quasi-linear
/// viscoelasticity (Fung 1993, 7.6) by a Prony series. docs/decisions/0040-relaxation.md has the choices.
namespace palpate {

/// Of a tissue's series.
inline constexpr std::size_t kMostRelaxationTerms = 2;
/// So many different times the tissues of one model may have together.
inline constexpr std::size_t kMostRelaxationTimes = 16;
/// Both ends belong to it.
struct RelaxationTimeRange {
  double min_s, max_s;
};
inline constexpr RelaxationTimeRange kRelaxationTimeRange{0.01, 1000};

struct RelaxationTerm {
  double part = 0;    ///< of the modulus, that is lost in the end; 0: no term
  double time_s = 0;  ///< in which all but 1/e of it is lost; in kRelaxationTimeRange
  bool operator==(const RelaxationTerm&) const = default;
};

/// How the stress of a strain that is held falls: E(t) = E (1 - sum of g_i (1 - exp(-t / tau_i))), where E is
/// what the tissue has at once. Those that have parts stand first.
struct Relaxation {
  std::array<RelaxationTerm, kMostRelaxationTerms> term;

  /// Of the modulus, that is lost in the end; below 1.
  double part() const;
  bool relaxes() const { return term[0].part > 0; }
  bool operator==(const Relaxation&) const = default;
};

/// The different times of a model's tissues, the shortest first.
struct RelaxationTimes {
  std::array<double, kMostRelaxationTimes> time_s{};
  std::size_t count = 0;

  bool any() const { return count > 0; }
  /// Takes in those of a series. @returns false: there is no room for them
  bool add(const Relaxation& relaxation);
};

/// What relaxes with each of a model's times, as parts of the modulus; together below 1.
struct RelaxedParts {
  std::array<double, kMostRelaxationTimes> of_time{};

  /// @param weight  of the tissue that has this series
  void add(const Relaxation& relaxation, const RelaxationTimes& times, double weight);
  void add(const RelaxedParts& other, double weight);
  bool any() const;
  /// So that those that are none leave the hash as it is.
  void hash_into(std::uint64_t& hash) const;
};

/// What a hand remembers of how the tissue that it presses has relaxed.
struct RelaxationState {
  /// Of the law at once: at the depth that the tool is in, or, where its dent is deeper, at that.
  double elastic_N = 0;
  /// The same, lagging by each of the model's times: of part g of the modulus the force g x this is lost.
  std::array<double, kMostRelaxationTimes> lagging_N{};
  RelaxedParts parts;    ///< as they are felt, or were where the dent is
  Point<Patient> at;     ///< on the surface at rest, where it was pressed last
  bool presses = false;  ///< it was pressed in the last tick

  bool remembers() const { return elastic_N > 0; }
  void hash_into(std::uint64_t& hash) const;
};

/// What is left of x = time over time constant: exp(-x), and its mean on the way there, (1 - exp(-x)) / x, to
/// 1e-14. The same bits on every machine, which std::exp does not promise.
/// @param x  at least 0
struct Decay {
  double left = 1, mean = 1;
};
Decay decay(double x);

/// Where a tool is in tissue that relaxes.
struct RelaxingContact {
  RelaxedParts parts;   ///< of the tissue there
  Point<Patient> at;    ///< on the surface at rest
  double reach_mm = 1;  ///< of a dent that the tool makes, above 0
  double blend_s = 1;   ///< in which other parts take the place of those that were felt; above 0
};

/// A tick of what relaxes: the force that is left of the elastic one,
///
///     F = F_e - sum of g_i p_i,   tau_i dp_i/dt = F_e - p_i,
///
/// exact where F_e changes evenly in the tick, whatever its length (Taylor, Pister & Goudreau 1970; Simo &
/// Hughes 1998, 10.3). A tool that goes out faster than the tissue follows leaves its dent: no force then,
/// and F_e is that of the dent, which fills up as free tissue does. So no energy is given out (0040). What is
/// touched again a way from where it was pressed has so much less of a dent, and none beyond its reach.
/// Bounded work, the same bits on every build.
/// @param elastic_N  of the law at the tool's depth, at least 0
/// @param contact    null: it touches nothing that yields, and elastic_N is 0
/// @returns N, 0 ... elastic_N
double advance_relaxation(const RelaxationTimes& times, double elastic_N, const RelaxingContact* contact,
                          double dt_s, RelaxationState& state);

}  // namespace palpate
