#pragma once

#include "scene/table_reader.h"

namespace palpate {

/// Reads the tools of all devices, and protects structures from the shavers among them.
void read_tools(const TableReader& top, Scene& scene, Problems& problems);

}  // namespace palpate
