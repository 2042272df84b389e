#pragma once

#include <span>
#include <vector>

#include "palpate/palpation/palpation.h"

namespace palpate {

struct SurfaceCandidate {
  SurfacePoint surface;
  double score = 0;  ///< above 0: how well it suits a press
};

/// Centres of a structure's voxels with free space beside them, without those where the scan cuts it off.
std::vector<Point<Patient>> border_voxels(const Model& model, LabelId structure);

/// Places on the surface of a structure that suit a press, best first: even, its own, free in front.
/// @param border  where to look: border_voxels() or some of them
std::vector<SurfaceCandidate> surface_candidates(const Model& model, LabelId structure,
                                                 std::span<const Point<Patient>> border, double clearance_mm);

}  // namespace palpate
