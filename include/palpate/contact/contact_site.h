#pragma once

#include "palpate/volume/volume.h"

namespace palpate {

/// Structure in contact at a point of the field, and the depth below its surface.
struct ContactSite {
  LabelId label = 0;  ///< Label of the structure. 0: none within reach
  /// Index of the label's tissue. -1: none.
  int tissue = -1;
  /// Field value at which the structure counts as entered: deep inside it for smoothed labels, at a depth of
  /// 1 mm for ramps.
  double level = 0;
  double depth_mm = 0;  ///< Depth of the tip along the normal; > 0 below the structure's surface, < 0 above
};

}  // namespace palpate
