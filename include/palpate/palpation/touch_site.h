#pragma once

#include <optional>
#include <string>
#include <vector>

#include "palpate/palpation/free_path.h"
#include "palpate/palpation/palpation.h"

namespace palpate {

/// Requested contact point of an approach.
struct TouchRequest {
  std::optional<Vector<Patient>> landmark;  ///< Unit direction whose extreme point is requested
  std::vector<Point<Patient>> near;  ///< Points, the nearest to any of which is requested; empty: anywhere
  /// Unit vector towards the approaching hand; empty: chosen by reachability
  std::optional<Vector<Patient>> from;
  double clearance_mm = 15;  ///< Length of the final straight segment, limited by the free space
};
/// Tolerance between the requested and the chosen place.
inline constexpr double kPositionTolerance_mm = 5;

/// Contact point with a collision-free path: from the air around the patient to `before`, then straight.
struct TouchSite {
  SurfacePoint surface;
  Vector<Patient> from;     ///< Unit vector along the straight segment, away from the surface
  Point<Patient> before;    ///< Beginning of the straight segment
  Point<Patient> in_front;  ///< End of the straight segment: the tool just clears the surface
};

struct TouchSites {
  std::vector<TouchSite> sites;  ///< Best first, some millimetres apart
  std::string why_none;          ///< Reason if there are none
};

/// Radius of the tool about its tip, mm.
double tool_reach_mm(const Tool& tool);

/// Contact points for an approach, best first.
/// @param structure  a structure with contact
TouchSites find_touch_sites(const Model& model, const FreeSpace& free_space, LabelId structure,
                            const TouchRequest& wish);

/// Structure with contact whose voxels are nearest to a point, within kPositionTolerance_mm; 0: none.
LabelId contact_structure_near(const Model& model, const Point<Patient>& point);

}  // namespace palpate
