#pragma once

#include <memory>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/volume/label_map.h"

namespace palpate {

/// Flat wall of bone of 1 N/mm: the half of a volume below x = 0, ready for the proxy only. The patient's
/// origin is on its surface, at the centre of the volume.
Result<std::shared_ptr<const Model>> flat_wall(const Progress& progress = {});

/// Label map of the wall; label 1.
LabelMap flat_wall_labels();
/// Larger wall, 36 mm deep and 24 mm to each side. With the low stiffness of a slow loop a hand sinks in by
/// up to a centimetre, and beyond the middle of a structure the nearest surface is on the other side; a
/// sliding hand must not reach the rim either.
LabelMap thick_wall_labels();

/// Model with label 1 as bone of 1 N/mm, named like the segment, ready for these methods.
Result<std::shared_ptr<const Model>> one_bone(const LabelMap& labels, const std::vector<ForceMethod>& methods,
                                              const Progress& progress);

}  // namespace palpate
