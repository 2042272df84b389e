#pragma once

#include <algorithm>
#include <array>
#include <limits>
#include <span>

#include "contact/capsule_row.h"
#include "contact/half_spaces.h"
#include "contact/uninitialised_array.h"
#include "palpate/contact/proxy.h"

/// Broad phase of the proxy: sphere-surface pairs within reach of a tick's path, with cached clearances, and
/// the projection of a position out of the surfaces.
namespace palpate {

/// Capacity in pairs of a tool part and a surface. If more pairs are near, the nearest are kept and the path
/// is limited to the distance within which they are complete.
inline constexpr std::size_t kMaxPairs = 32;

/// Number of layers of the surfaces.
inline int layer_count(std::span<const ContactSurface> surfaces) {
  int innermost = 0;
  for (const ContactSurface& surface : surfaces) innermost = std::max(innermost, surface.layer);
  return std::min(innermost + 1, kMaxLayers);
}

/// Whether a layer's proxy can touch surface `s`: it is in that layer, has geometry, and is neither punctured
/// nor covered by a surface that is not punctured.
inline bool can_touch(std::span<const ContactSurface> surfaces, int layer, const SurfaceSet& punctured,
                      std::size_t s) {
  const ContactSurface& surface = surfaces[s];
  const bool covered = surface.covered_by >= 0 && !punctured[static_cast<std::size_t>(surface.covered_by)];
  return surface.layer == layer && surface.surface != nullptr && !punctured[s] && !covered;
}

/// Pair of a tool part and a surface that it may touch in this tick.
struct ContactPair {
  const Surface* surface;
  int index;  ///< Index into the surfaces
  int part;   ///< Index of the tool part
  ToolPart shape;
  int steps;  ///< Number of intervals in a capsule's row of spheres. 0: a sphere

  /// Position of a step on the capsule's axis, 0 ... 1.
  double axis_fraction(int step) const { return steps == 0 ? 0 : static_cast<double>(step) / steps; }
  /// Vector from the tip to the centre of a step's sphere.
  Vector<Patient> offset_mm(int step) const { return shape.offset_mm + shape.axis_mm * axis_fraction(step); }
  double radius_mm(int step) const { return shape.radius_at_mm(axis_fraction(step)); }

  struct Clearance {
    double mm;  ///< Signed clearance by the distance field; negative: penetration
    int step;   ///< Step of the nearest sphere
  };
  /// Clearance with the tip's proxy at `proxy`. For a capsule that is nowhere nearer than `cutoff_mm` the
  /// result may be any lower bound above that.
  /// @param begin    step at which the search starts
  /// @param queries  incremented by the number of surface queries
  Clearance clearance(const Point<Patient>& proxy, double cutoff_mm, int begin, int& queries) const {
    const Point<Patient> centre = proxy + shape.offset_mm;
    if (steps == 0) {
      ++queries;
      return {surface->distance_mm(centre) - shape.radius_mm, 0};
    }
    const NearestInRow nearest =
        nearest_in_row(*surface, centre, shape, steps, begin, cutoff_mm + shape.radius_mm, queries);
    return {nearest.distance_mm - shape.radius_mm, nearest.step};
  }
};

/// Set of the pairs that a layer's proxy can touch, nearest first, each with its last evaluated clearance.
/// Does not allocate.
class PairSet {
 public:
  /// An empty set.
  PairSet() = default;
  PairSet(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
          const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm) {
    gather(surfaces, parts, layer, punctured, at, reach_mm);
  }

  /// Replaces the set by the pairs that a layer's proxy can touch on a path of length `reach_mm` from `at`.
  /// If there are more than kMaxPairs, reach_mm() is shorter.
  /// @param parts  tool parts in the proxy's attitude
  void gather(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
              const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm);

  /// Empties the set.
  void clear() { count_ = 0; }
  /// Adds a pair from an earlier tick, with unknown clearance. Precondition: count() < kMaxPairs.
  const ContactPair& add_cached(const ContactPair& pair) { return pairs_.make(count_++, pair); }

  std::size_t count() const { return count_; }
  const ContactPair& operator[](std::size_t n) const { return pairs_[n]; }
  std::size_t index_of(const ContactPair& pair) const {
    return static_cast<std::size_t>(&pair - pairs_.data());
  }
  double reach_mm() const { return reach_mm_; }
  /// Maximum slope of the distance fields in the set; at least 1.
  double max_gradient() const;
  /// Whether any sphere was inside a surface at the position passed to gather().
  bool penetrates() const { return count_ > 0 && clearances_mm_[0] <= -kProxySettings.outside_mm; }

  /// Clearance of pair n, or a lower bound above `cutoff_mm` where that is cheaper. Cached: a clearance
  /// decreases by at most the surface's maximum slope times the displacement.
  double clearance(std::size_t n, const Point<Patient>& proxy,
                   double cutoff_mm = std::numeric_limits<double>::infinity());
  /// Step of the capsule's row at which the last clearance of pair n was found.
  int step(std::size_t n) const { return evaluations_[n].step; }
  /// Middle of the contact interval on a capsule's axis that contains sphere `step`, 0 ... 1.
  double middle_of_touching(std::size_t n, const Point<Patient>& proxy, int step);

  /// Number of surface queries since construction; the measure of a tick's work.
  int queries() const { return queries_; }

  /// Rotates the tool of the gathered pairs.
  /// @param parts  tool parts in the new attitude
  void turn(std::span<const ToolPart> parts);

 private:
  // last evaluation of a pair: the clearance decreases by at most the surface's maximum slope per mm
  struct Evaluation {
    Point<Patient> centre;
    double clearance_mm = 0;
    double cutoff_mm = 0;  // above this, clearance_mm may be a lower bound
    int step = 0;
  };

  Evaluation evaluate(const ContactPair& pair, const Point<Patient>& proxy, double cutoff_mm, int begin);

  void insert(const ContactPair& pair, double clearance_mm, const Evaluation& evaluation);

  UninitialisedArray<ContactPair, kMaxPairs> pairs_;
  UninitialisedArray<double, kMaxPairs> clearances_mm_;
  UninitialisedArray<Evaluation, kMaxPairs> evaluations_;
  std::size_t count_ = 0;
  int queries_ = 0;
  // smallest clearance of a pair rejected because the set was full
  double min_rejected_mm_ = std::numeric_limits<double>::infinity();
  double reach_mm_ = 0;
};

/// Whether no tool part penetrates any surface that the layer's proxy can touch.
/// @param ignored  surfaces that are ignored
/// @param at       position of the tip
bool is_free(std::span<const ContactSurface> surfaces, std::span<const ToolPart> parts, int layer,
             const SurfaceSet& punctured, const SurfaceSet& ignored, const Point<Patient>& at);

/// Half-space constraints, each with the sphere-surface pair that it comes from.
class ContactConstraints {
 public:
  bool full() const { return count_ == kMaxHalfSpaces; }
  void clear() { count_ = 0; }
  /// Adds the tangent plane of the pair's surface at a position of the tip with a known clearance. A full set
  /// replaces a weaker parallel plane. Returns false if the surface has no normal there, or there is no room.
  /// @param step  step of the capsule's row that has this clearance
  bool add(const ContactPair& pair, int step, const Point<Patient>& at, double clearance_mm);
  /// Adds the half-space of a sphere from an earlier tick. Precondition: not full.
  void add_cached(const ContactPair& pair, const HalfSpace& plane) { put(count_++, pair, 0, plane); }
  std::size_t count() const { return count_; }
  std::span<const HalfSpace> half_spaces() const { return {half_spaces_.data(), count_}; }
  const HalfSpace& half_space(std::size_t n) const { return half_spaces_[n]; }
  const ContactPair& pair(std::size_t n) const { return *pairs_[n]; }
  int step(std::size_t n) const { return step_[n]; }

 private:
  std::size_t index_of_weaker(const HalfSpace& plane) const;
  void put(std::size_t index, const ContactPair& pair, int step, const HalfSpace& plane);

  UninitialisedArray<HalfSpace, kMaxHalfSpaces> half_spaces_;
  UninitialisedArray<const ContactPair*, kMaxHalfSpaces> pairs_;
  UninitialisedArray<int, kMaxHalfSpaces> step_;
  std::size_t count_ = 0;
};

/// Projects a position out of every surface of the set that it penetrates slightly, by repeated closest-point
/// solves.
/// @param step_mm  maximum length of each step, because nearly opposite planes have a distant intersection
/// @param proxy    updated only on success
/// @return false if no position outside was found within max_steps
bool project_out(PairSet& pairs, int max_steps, double step_mm, Point<Patient>& proxy);

}  // namespace palpate
