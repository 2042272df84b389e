#include "model/surface_reach.h"

#include <algorithm>
#include <cstdio>

namespace palpate {
namespace {

double widest_radius_mm(const Tool& tool) {
  double widest_mm = tool.radius_mm;
  for (const ToolCapsule& capsule : tool.capsules) widest_mm = std::max(widest_mm, capsule.radius_mm);
  if (tool.burr) widest_mm = std::max(widest_mm, tool.burr->end_radius_mm);
  return widest_mm;
}

}  // namespace

Result<SurfaceOptions> touchable_surface_options(std::span<const Tool> tools, const GridGeometry& grid) {
  SurfaceOptions options;
  const double spacing_mm = grid.spacing_mm.maxCoeff();
  for (std::size_t number = 0; number < tools.size(); ++number) {
    const double radius_mm = widest_radius_mm(tools[number]);
    // the centre's distance is only valid if the voxels around it are in range too
    if (radius_mm + spacing_mm > kMaxSurfaceReach_mm) {
      char what[200];
      std::snprintf(what, sizeof what,
                    "a tool of %.3g mm radius is too wide for voxels of %.3g mm: the sum exceeds %g mm",
                    radius_mm, spacing_mm, kMaxSurfaceReach_mm);
      return Error{ErrorKind::kBadInput, what, "",
                   std::string("set a smaller `radius` under [") + (number == 0 ? "tool" : "second_tool") +
                       "], or give labels with finer voxels"};
    }
    const double needed_mm = radius_mm + std::max(1.0, 2 * spacing_mm - 1);
    options.reach_mm = std::clamp(needed_mm, options.reach_mm, kMaxSurfaceReach_mm);
  }
  return options;
}

}  // namespace palpate
