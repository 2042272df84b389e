#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "palpate/geometry/geometry.h"

/// Permanent holes of tools in tissue that stays open after a puncture. Positions are in the patient frame.
namespace palpate {

/// Correspondence of a surface to those before a change of the surfaces.
struct SurfaceCorrespondence {
  std::int16_t index;  ///< Index of the same structure's surface before the change. -1: none
  bool is_unchanged;   ///< Whether shape and position are unchanged; contact properties may differ
};

/// Straight cylindrical path into a structure with the radius of the tool part that made it.
struct Hole {
  int structure = -1;      ///< Index into the surfaces
  Point<Patient> at;       ///< Centre of the tool part at the puncture, in contact with the surface
  Vector<Patient> inward;  ///< Direction into the structure; unit
  double length_mm = 0;    ///< Maximum distance along `inward` that the centre has reached
  double radius_mm = 0;    ///< Radius of the tool part

  /// Whether a tool part at `centre` fits into the hole, from either end.
  /// @param centre     centre of the tool part
  /// @param radius_mm  its radius; at most that of the hole
  bool fits(const Point<Patient>& centre, double radius_mm) const;
};

/// The most recent holes of all tools. Trivially copyable, without pointers; does not allocate, lock or
/// throw.
class Holes {
 public:
  static constexpr std::size_t kCapacity = 32;  ///< Maximum number of holes; a further one closes the oldest

  std::span<const Hole> all() const { return {hole_.data(), count_}; }
  bool empty() const { return count_ == 0; }
  /// Adds a hole. If there are kCapacity, the oldest is closed.
  void add(const Hole& hole);
  /// Extends the holes around a tool part that has punctured a structure to its current centre.
  void extend(int structure, const Point<Patient>& centre);
  /// Transfers the holes to a changed set of surfaces; holes in structures that no longer exist are dropped.
  /// @param correspondences  correspondence for each of the new surfaces
  void transfer(std::span<const SurfaceCorrespondence> correspondences);
  void hash_into(std::uint64_t& hash) const;

 private:
  std::array<Hole, kCapacity> hole_;
  std::size_t count_ = 0, oldest_ = 0;
};

}  // namespace palpate
