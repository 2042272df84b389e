#pragma once

#include <vector>

#include "palpate/haptics/haptics.h"
#include "palpate/servo/servo.h"

namespace palpate {

/// A tick of a sweep in which a structure is touched.
struct SweptForce {
  double depth_mm = 0;  ///< distance of the tip from where the sweep touched first
  double force_N = 0;   ///< at the device, before the output stage
  LabelId label = 0;    ///< outermost structure that is touched
  LabelId deepest = 0;  ///< innermost structure that has a share of the force
};

/// Force over depth of a tip that descends along a line at 20 mm/s, from ticks with the method, gains and
/// bound of stiffness of `parameters`, without friction, viscosity, damping and limits of the force. It ends
/// at `max_mm` below the first contact, or where the contact is lost. Empty: nothing within `max_mm` of the
/// line.
/// @param model    ready for the method
/// @param start    in free space
/// @param inward   unit
std::vector<SweptForce> sweep_force(const Model& model, const Parameters& parameters,
                                    const Point<Patient>& start, const Vector<Patient>& inward, double max_mm,
                                    double rate_hz);

}  // namespace palpate
