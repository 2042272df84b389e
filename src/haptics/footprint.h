#pragma once

#include <cstddef>
#include <span>

#include "palpate/haptics/proxy.h"

/// A tool of several parts, or one that lies along soft tissue, as what it presses with.
namespace palpate {

/// A sphere of the tool, or one of a row along a capsule, that would be below the surface at rest.
struct PressPlace {
  Vector<Patient> middle_mm;  ///< of it, from the tip
  double radius_mm = 0;       ///< above 0
  double depth_mm = 0;        ///< of the sphere in the surface at rest; above 0
};
inline constexpr std::size_t kMostPressPlaces = 24;

/// What such places are together, as one sphere of the tick's law (yield.h).
struct Footprint {
  double depth_mm = 0, radius_mm = 0;
  /// By so much more it gives way per newton than that sphere, times E*: each place sinks in where the others
  /// press, 1 / (pi E* r) (Boussinesq).
  double closeness_per_mm = 0;
  double stiffer = 1;      ///< dF/dd of all that go down together, of that sphere's; at least 1
  Vector<Patient> arm_mm;  ///< from the tip to where it acts on the surface: mean by the force
};

/// Far from each other places press by Hertz's law, f ~ sqrt(R) d^1.5 each. So of one sphere with the mean
/// depth by force, and with such a radius that it has the sum of the forces, force and energy are exact. What
/// lies behind another place along the push presses nothing: a place that is less than its radius aside of
/// one that is deeper counts by that part. No step comes in as a place goes down through the surface or
/// passes another one. Bounded work; allocates, locks and throws nothing.
/// @param places  at least one, at most kMostPressPlaces
/// @param along   unit, the way on which the tissue pushes them back
Footprint footprint_of(std::span<const PressPlace> places, const Vector<Patient>& along);

/// The places of a tool whose tip is at `tip`: of every sphere one, of capsules rows that are no closer than
/// their radius. Depths are those in the deepest of some surfaces.
/// @param surfaces  that the tool leans on, by their places among `all`; each once
/// @returns how many were found, the tool's order
std::size_t press_places(std::span<const FeltSurface> all, std::span<const int> surfaces,
                         std::span<const ToolSphere> spheres, const Point<Patient>& tip,
                         std::span<PressPlace> places);

}  // namespace palpate
