#pragma once

#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/haptics/haptics.h"

namespace palpate {

/// The half of a volume below x = 0, of bone of 1 N/mm, ready for the proxy alone: a flat wall to press on.
/// The patient's origin is on its surface, in the middle of the volume.
Result<std::shared_ptr<const Model>> flat_wall(const Progress& progress = {});

/// Label 1 is that half.
LabelMap flat_wall_labels();
/// The same, larger: 36 mm deep and 24 to each side. Where a slow loop allows little stiffness a hand sinks
/// in by up to a centimetre, and beyond the middle of a structure the way out of it changes sides; nor may a
/// hand that slides come to the rim.
LabelMap thick_wall_labels();

/// Label 1 as bone of 1 N/mm, which has the segment's name, ready for these methods.
Result<std::shared_ptr<const Model>> one_bone(const LabelMap& labels, const std::vector<ForceMethod>& methods,
                                              const Progress& progress);

}  // namespace palpate
