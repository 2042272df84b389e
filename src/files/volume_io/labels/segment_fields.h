#pragma once

#include <vector>

#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

namespace palpate::volume_io {

/// Assigns each segment an id: its value if that is free, otherwise the lowest number above all values and
/// ids, in order of (layer, value); sorts the segments by id. Returns false if 65535 ids do not suffice.
bool number_segments(std::vector<Segment>& segments);

/// Colour for a segment without one; segments with successive ids are distinguishable.
Rgb colour_for(LabelId id);

}  // namespace palpate::volume_io
