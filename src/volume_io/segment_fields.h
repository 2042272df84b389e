#pragma once

#include <vector>

#include "palpate/volume/volume.h"

namespace palpate::volume_io {

/// Gives each segment its id: its value where that is free, else the lowest number above every value
/// and id, in order of (layer, value); sorts by id. False when 65535 ids are not enough.
bool number_segments(std::vector<Segment>& segments);

/// A colour that tells neighbours in a picture apart, for a segment that has none.
Rgb colour_for(LabelId id);

}  // namespace palpate::volume_io
