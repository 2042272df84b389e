#pragma once

#include <span>
#include <vector>

#include "palpate/tissue/carving.h"

namespace palpate {

/// Largest volume of a fragment that is removed; larger pieces stay in place.
inline constexpr double kMaxFragment_mm3 = 20;

/// Fragments that cuts have severed from the body, as cuts with Cut::device = Cut::kBrokenOff that remove
/// them, because a fragment would be rinsed away. A fragment is a 26-connected component of voxels of
/// touchable tissue of at most kMaxFragment_mm3 that was part of a larger component before any removal.
/// Components with a voxel of a structure that has a protection stay in place. The motor does no work on
/// fragments, and no energy is charged for them.
///
/// The result depends on the remaining labels next to the cuts alone. The cost is proportional to the surface
/// of the cuts and kMaxFragment_mm3, in voxels.
/// @param model    model with which the carving began, or a later version
/// @param carving  carving after `cuts`
/// @return  capsules along the rows of voxels, with the stroke of the last cut
std::vector<Cut> fragments_of(const Model& model, const Carving& carving, std::span<const Cut> cuts);

}  // namespace palpate
