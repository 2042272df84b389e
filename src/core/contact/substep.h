#pragma once

#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "palpate/contact/proxy.h"

/// Limit and validate stages of a substep.
namespace palpate {

/// End of a substep as far as its limits allow.
struct LimitedStep {
  Point<Patient> end;
  bool at_limit = false;  ///< Whether the displacement limit shortened it
};

/// Limit stage: the goal, or the point towards it at the maximum substep length or at the displacement limit.
/// In contact the length is halved where the direction reversed, which occurs on concave surfaces whose
/// radius of curvature is less than the depth.
/// @param layer   position and last displacement of the proxy
/// @param max_mm  maximum substep length
LimitedStep limit_step(const ProxyLayer& layer, const Point<Patient>& goal, double max_mm, bool in_contact,
                       const DisplacementLimit& limit);

/// Conditions of a valid substep.
struct StepConditions {
  Point<Patient> tip;
  double substep_mm = 0;  ///< Substep length along the surfaces
  double max_away = 0;    ///< Maximum fraction of the substep by which the distance to the tip may increase
};

/// Result of the validation of a substep.
struct ValidatedStep {
  bool accepted = false;
  bool at_limit = false;    ///< Whether the displacement limit shortened the projected substep
  Point<Patient> end;       ///< End of the substep before the projection
  Point<Patient> position;  ///< End projected out of all surfaces
};

/// Validate stage: projects the end of a substep back outside the surfaces. The substep is rejected if there
/// is no position outside, if it could have penetrated deeper between its ends, or if it increases the
/// distance to the tip, so that the proxy comes to rest where constraints turn within one substep.
ValidatedStep validate_step(PairSet& pairs, const Point<Patient>& from, const Point<Patient>& end,
                            const StepConditions& conditions, const DisplacementLimit& limit);

}  // namespace palpate
