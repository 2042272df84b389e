#pragma once

#include <span>

#include "palpate/contact/model.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {

/// Options for surfaces in contact with tools, on a label volume's grid. The centre of a sphere in contact is
/// its radius away from the surface, and the distance there is interpolated from voxels that lie farther
/// (docs/decisions/0078-reach-follows-the-tool.md). Errors: kBadInput if a tool is too wide for the spacing,
/// because the distance field's range is limited.
Result<SurfaceOptions> touchable_surface_options(std::span<const Tool> tools, const GridGeometry& grid);

}  // namespace palpate
