#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "palpate/geometry/geometry.h"

/// What tools leave behind in tissue that stays open after a puncture. Positions in the patient frame.
namespace palpate {

/// Which of the surfaces before a change one of those after it was.
struct SurfaceBefore {
  std::int16_t index;  ///< of the same structure's; -1: it had none
  bool same;           ///< in shape and place, however it feels now
};

/// A straight way into a structure, as wide as what went through.
struct Hole {
  int structure = -1;      ///< its place among the surfaces
  Point<Patient> at;       ///< middle of what went through, where it leant on the surface
  Vector<Patient> inward;  ///< unit
  double length_mm = 0;    ///< as far in as that middle has come
  double radius_mm = 0;    ///< of the part of the tool that went through

  /// Whether the middle of a part of a tool is where it can go in, from either end.
  /// @param radius_mm  of that part; it fits where it is no wider than the hole
  bool lets_in(const Point<Patient>& middle, double radius_mm) const;
};

/// The latest holes of all tools. Small and without pointers; nothing allocates, locks or throws.
class Holes {
 public:
  static constexpr std::size_t kMost = 32;

  std::span<const Hole> all() const { return {hole_.data(), count_}; }
  bool empty() const { return count_ == 0; }
  /// Where there are kMost, the oldest one closes.
  void make(const Hole& hole);
  /// A middle that went through a structure has come to there: the holes around it are as long as that.
  void lead(int structure, const Point<Patient>& middle);
  /// After a change of the surfaces. A hole in a structure that is not there any more is forgotten.
  /// @param before  one for each surface of now
  void keep(std::span<const SurfaceBefore> before);
  void hash_into(std::uint64_t& hash) const;

 private:
  std::array<Hole, kMost> hole_;
  std::size_t count_ = 0, oldest_ = 0;
};

}  // namespace palpate
