#pragma once

#include "palpate/scene/scene.h"
#include "scene/table_reader.h"

/// Checks across the tables of a scene. Those that add to `problems` name the line of the table at fault.
namespace palpate {

/// Checks that tissues' names are unique, and that tissues rest on tissues of the scene.
void check_names(const Scene& scene, Problems& problems);
/// Checks that no tissue rests on itself through others. Requires valid names (check_names()).
void check_support_cycles(const Scene& scene, Problems& problems);
/// Checks that no tissue is stiffer than one that it rests on, as support_fault() defines it. Requires valid
/// names.
void check_stiffness_order(const Scene& scene, Problems& problems);
/// Checks that the volume each tissue is derived from is given.
/// @param data_line  line of [data]
void check_volumes(const Scene& scene, int data_line, Problems& problems);
/// Checks that the files exist and do not leave the scene's folder through a link. Their contents are checked
/// by their readers. Errors: kBadInput.
Result<void> check_files(const Scene& scene);

}  // namespace palpate
