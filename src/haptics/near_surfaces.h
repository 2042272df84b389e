#pragma once

#include <array>
#include <limits>
#include <span>

#include "haptics/capsule_row.h"
#include "haptics/half_spaces.h"
#include "haptics/room_for.h"
#include "palpate/haptics/proxy.h"

/// What the tool can meet in a tick, and how it is kept outside of that.
namespace palpate {

/// Pairs of a sphere or capsule and a surface that are looked at; where more are near at once the proxy goes
/// no farther than the others allow.
inline constexpr std::size_t kMostNear = 32;

/// Whether the tool can meet a surface with the proxy of a layer.
inline bool is_there(std::span<const FeltSurface> surfaces, int layer, const SurfaceSet& punctured,
                     std::size_t s) {
  const FeltSurface& felt = surfaces[s];
  const bool covered = felt.beneath >= 0 && !punctured[static_cast<std::size_t>(felt.beneath)];
  return felt.layer == layer && felt.surface != nullptr && !punctured[s] && !covered;
}

/// A sphere or capsule of the tool and a surface that it may meet in this tick.
struct Near {
  const Surface* surface;
  int index, sphere;
  ToolSphere shape;
  int steps;  ///< of a capsule's row of spheres; 0: a sphere

  /// Where on a capsule's axis a step is, 0 ... 1.
  double part(int step) const { return steps == 0 ? 0 : static_cast<double>(step) / steps; }
  /// From the tip to the centre of a step's sphere.
  Vector<Patient> offset_mm(int step) const { return shape.offset_mm + shape.along_mm * part(step); }
  double radius_mm(int step) const { return shape.radius_at_mm(part(step)); }

  struct Clearance {
    double mm;  ///< negative: below the surface; in the surface's own measure of distance
    int step;   ///< of the sphere that is nearest
  };
  /// Of a capsule a lower bound above `enough_mm` where that is cheaper to know.
  Clearance clearance(const Point<Patient>& proxy, double enough_mm, int begin, int& looks) const {
    const Point<Patient> centre = proxy + shape.offset_mm;
    if (steps == 0) {
      ++looks;
      return {surface->distance_mm(centre) - shape.radius_mm, 0};
    }
    const NearestInRow nearest =
        nearest_in_row(*surface, centre, shape, steps, begin, enough_mm + shape.radius_mm, looks);
    return {nearest.distance_mm - shape.radius_mm, nearest.step};
  }
};

class NearSurfaces {
 public:
  /// None.
  NearSurfaces() = default;
  NearSurfaces(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
               const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm) {
    gather(surfaces, spheres, layer, punctured, at, reach_mm);
  }

  /// Those that a layer's proxy can reach from `at` on a way of `reach_mm`. Where they are too many, the way
  /// is as long as the nearest ones allow. In place of those that were there.
  /// @param spheres  as the proxy's attitude turns them
  void gather(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
              const SurfaceSet& punctured, const Point<Patient>& at, double reach_mm);

  /// None, until pairs are gathered or recalled.
  void clear() { count_ = 0; }
  /// A pair that was gathered in an earlier tick: nothing is known of its clearance. No more than there is
  /// room for.
  const Near& recall(const Near& near) { return near_.make(count_++, near); }

  std::size_t count() const { return count_; }
  const Near& operator[](std::size_t n) const { return near_[n]; }
  std::size_t place_of(const Near& near) const { return static_cast<std::size_t>(&near - near_.data()); }
  double reach_mm() const { return reach_mm_; }
  /// The greatest slope of any of them, at least 1.
  double steepest() const;
  /// Whether a sphere lay in a surface where they were gathered.
  bool is_in_one() const { return count_ > 0 && clearances_mm_[0] <= -kProxyFeel.outside_mm; }

  /// The clearance of pair n, or, where that is cheaper to know, a lower bound of it above `enough_mm`.
  double clearance(std::size_t n, const Point<Patient>& proxy,
                   double enough_mm = std::numeric_limits<double>::infinity());
  /// Of a capsule: the step of its row that had the clearance which was asked for last.
  int step(std::size_t n) const { return known_[n].step; }
  /// Where a capsule lies on the surface with one step of its row: the middle of that part of its axis, 0
  /// ... 1.
  double middle_of_touching(std::size_t n, const Point<Patient>& proxy, int step);

  /// How often surfaces were asked, for all that was gathered and since: what a tick costs goes with that.
  int looks() const { return looks_; }

  /// The same pairs of a tool that has turned: `spheres` as another attitude turns them.
  void turn(std::span<const ToolSphere> spheres);

 private:
  // what is known of a pair's clearance: it falls no faster than its surface is steep
  struct Known {
    Point<Patient> centre;
    double clearance_mm = 0;
    double enough_mm = 0;  // above this it may be a lower bound of the clearance
    int step = 0;
  };

  Known look(const Near& near, const Point<Patient>& proxy, double enough_mm, int begin);

  void insert(const Near& near, double clearance_mm, const Known& known);

  RoomFor<Near, kMostNear> near_;
  RoomFor<double, kMostNear> clearances_mm_;
  RoomFor<Known, kMostNear> known_;
  std::size_t count_ = 0;
  int looks_ = 0;
  double left_out_mm_ = std::numeric_limits<double>::infinity();
  double reach_mm_ = 0;
};

/// Whether no sphere lies in any surface of a layer that it can meet, but these.
bool is_free(std::span<const FeltSurface> surfaces, std::span<const ToolSphere> spheres, int layer,
             const SurfaceSet& punctured, const SurfaceSet& but, const Point<Patient>& at);

/// Half-spaces with what they belong to.
class Walls {
 public:
  bool full() const { return count_ == kMostHalfSpaces; }
  void clear() { count_ = 0; }
  /// The tangent plane at a place whose clearance is known: the surface lies that much farther along it.
  /// False where there is no direction, or no room.
  /// @param step  of the sphere of the near capsule that has this clearance
  bool add(const Near& near, int step, const Point<Patient>& at, double clearance_mm);
  /// One of a sphere that was added in an earlier tick; where there is room.
  void recall(const Near& near, const HalfSpace& wall) { put(count_++, near, 0, wall); }
  std::size_t count() const { return count_; }
  std::span<const HalfSpace> half_spaces() const { return {half_spaces_.data(), count_}; }
  const HalfSpace& half_space(std::size_t n) const { return half_spaces_[n]; }
  const Near& near(std::size_t n) const { return *near_[n]; }
  int step(std::size_t n) const { return step_[n]; }

 private:
  std::size_t place_of_weaker(const HalfSpace& wall) const;
  void put(std::size_t place, const Near& near, int step, const HalfSpace& wall);

  RoomFor<HalfSpace, kMostHalfSpaces> half_spaces_;
  RoomFor<const Near*, kMostHalfSpaces> near_;
  RoomFor<int, kMostHalfSpaces> step_;
  std::size_t count_ = 0;
};

/// Puts a place back outside every surface that it lies a little below, in steps of so much at most: walls
/// that nearly face each other would send it far away. False where there is no such place near.
bool leave_surfaces(NearSurfaces& near, int most_steps, double step_mm, Point<Patient>& proxy);

}  // namespace palpate
