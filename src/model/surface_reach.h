#pragma once

#include <span>

#include "palpate/haptics/haptics.h"
#include "palpate/surfaces/surfaces.h"

namespace palpate {

/// The options of the surfaces that tools lean on, on a label volume's grid. The centre of a sphere that
/// touches a surface lies its radius away, and the distance there is interpolated between voxels that lie
/// farther (docs/decisions/0078-reach-follows-the-tool.md). Errors: kBadInput where a tool is too wide for
/// the spacing: no surface reaches so far.
Result<SurfaceOptions> felt_surface_options(std::span<const Tool> tools, const GridGeometry& grid);

}  // namespace palpate
