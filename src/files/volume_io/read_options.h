#pragma once

#include "palpate/volume_io/placement_options.h"

/// Settings of the process for reading volumes: set_placement_options(), set_read_as().
namespace palpate::volume_io {

/// Settings of one read, completed by those of the process.
PlacementOptions with_process_defaults(PlacementOptions placement_options);

}  // namespace palpate::volume_io
