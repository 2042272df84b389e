#pragma once

#include "palpate/haptics/haptics.h"
#include "palpate/link/viewer_server.h"
#include "palpate/scene/scene.h"

namespace palpate {

/// What a viewer shows of a model: volumes, structures, tissues, tools. What holds of a device and of what
/// may be changed is left as it is by default.
/// @param devices  of the session, at least one: each has its tool
/// @param said  as the scene says it; unknown: what the scan's values tell
ViewedScene viewed_scene(const Model& model, std::size_t devices, Modality said);

/// The tissues as a model has them.
std::vector<ViewedTissueState> viewed_tissues(const Model& model);

/// Of tissue that yields, force over depth at the device, N/mm: how stiff it is there and now. 0 without
/// depth.
double yielding_stiffness_N_per_mm(const DeviceTick& felt);

}  // namespace palpate
