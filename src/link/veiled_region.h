#pragma once

#include "palpate/link/viewed_training.h"
#include "palpate/link/viewer_server.h"

namespace palpate::link {

/// A task's region as it is to be looked at in a scene's own labels: middle, radius and outward direction are
/// computed again from ViewedTask::Region::extent. A region that has no extent, or no voxel of these labels,
/// is the whole volume.
ViewedTask::Region region_in(const ViewedScene& scene, const ViewedTask::Region& region);

}  // namespace palpate::link
