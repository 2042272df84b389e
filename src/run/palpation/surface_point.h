#pragma once

#include <span>
#include <vector>

#include "palpate/palpation/palpation.h"

namespace palpate {

struct SurfaceCandidate {
  SurfacePoint surface;
  double score = 0;  ///< Suitability for a press; positive
};

/// Voxel centres of a structure that border free space, excluding faces at which the scan ends.
std::vector<Point<Patient>> border_voxels(const Model& model, LabelId structure);

/// Surface points of a structure that suit a press, best first: flat, belonging to the structure, with free
/// space in front.
/// @param border  candidates: border_voxels() or a subset
std::vector<SurfaceCandidate> surface_candidates(const Model& model, LabelId structure,
                                                 std::span<const Point<Patient>> border, double clearance_mm);

}  // namespace palpate
