#pragma once

#include "scene/keys.h"

/// Tables of a scene file that have sources of their own; scene_keys.cc combines all tables.
namespace palpate {

// scene_tissue_keys.cc
TableSpec tissue_table();
TableSpec deformation_table();
TableSpec density_table();

// scene_tool_keys.cc
TableSpec tool_table();
TableSpec capsule_table();
/// Adds the tables of the second tool, which equal those of the first.
SceneKeys with_second_tool(SceneKeys keys);

}  // namespace palpate
