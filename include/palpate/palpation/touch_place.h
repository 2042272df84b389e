#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/palpation/free_path.h"
#include "palpate/palpation/palpation.h"

namespace palpate {

/// Where on a structure an approach is to touch.
struct TouchWish {
  std::optional<Vector<Patient>> landmark;  ///< farthest this way, unit
  std::vector<Point<Patient>> near;         ///< nearest to one of these; empty: anywhere
  std::optional<Vector<Patient>> from;      ///< whence the hand comes, unit; empty: whence it can
  double clearance_mm = 15;  ///< length of the last straight stretch, at most where that is free
};
/// What is asked for counts as met this far from it.
inline constexpr double kAstray_mm = 5;

/// A place with a free way to it: from the air about the patient to `before`, then straight.
struct TouchPlace {
  SurfacePoint surface;
  Vector<Patient> from;     ///< unit; the straight stretch comes from there
  Point<Patient> before;    ///< where it begins
  Point<Patient> in_front;  ///< where it ends: the tool is just free of the surface
};

struct TouchPlaces {
  std::vector<TouchPlace> places;  ///< best first, some millimetres apart
  std::string why_none;            ///< where there are none: in words
};

/// How far the tool stands out from its tip, mm.
double tool_reach_mm(const Tool& tool);

/// @param structure  is felt
TouchPlaces find_touch_places(const Model& model, const FreeSpace& free_space, LabelId structure,
                              const TouchWish& wish);

/// The felt structure whose voxels are nearest to a point, at most kAstray_mm away; 0: none.
LabelId felt_structure_near(const Model& model, const Point<Patient>& point);

}  // namespace palpate
