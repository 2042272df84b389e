#pragma once

#include <vector>

#include "palpate/contact/model.h"
#include "palpate/servo/servo.h"

namespace palpate {

/// A tick of a sweep in which a structure is touched.
struct SweptForce {
  double depth_mm = 0;  ///< Distance of the tip from the first contact of the sweep
  double force_N = 0;   ///< Force at the device, before the output stage
  LabelId label = 0;    ///< Outermost touched structure
  LabelId deepest = 0;  ///< Innermost structure that contributes to the force
};

/// Force over depth of a tip that descends along a line at 20 mm/s, computed by ticks with the method, gains
/// and stiffness limit of `parameters`, without friction, viscosity, damping and force limits. The sweep
/// ends at `max_mm` below the first contact, or where contact is lost. Empty if there is no contact within
/// `max_mm`.
/// @param model    ready for the method
/// @param start    in free space
/// @param inward   direction, unit vector
std::vector<SweptForce> sweep_force(const Model& model, const Parameters& parameters,
                                    const Point<Patient>& start, const Vector<Patient>& inward, double max_mm,
                                    double rate_hz);

}  // namespace palpate
