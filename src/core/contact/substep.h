#pragma once

#include "contact/force_continuity.h"
#include "contact/near_surfaces.h"
#include "palpate/contact/proxy.h"

/// Limit and validate stages of a substep.
namespace palpate {

/// Result of the limit stage.
struct LimitedStep {
  Point<Patient> end;
  bool at_limit = false;  ///< Whether the displacement limit shortened the substep
};

/// Limit stage: shortens the displacement to the goal to the maximum substep length and to the displacement
/// limit. In contact the length is halved if the direction has reversed since the last substep: on concave
/// surfaces whose radius of curvature is less than the depth, full substeps would oscillate around the goal.
/// @param layer   proxy, of which the position and the last displacement are used
/// @param max_mm  maximum substep length
LimitedStep limit_step(const ProxyLayer& layer, const Point<Patient>& goal, double max_mm, bool in_contact,
                       const DisplacementBall& limit);

/// Conditions of a valid substep.
struct StepConditions {
  Point<Patient> tip;
  double substep_mm = 0;  ///< Maximum length of a substep in contact
  /// Maximum fraction of the substep by which the distance to the tip may increase
  double max_distance_increase = 0;
};

/// Result of the validation of a substep.
struct ValidatedStep {
  bool accepted = false;
  bool at_limit = false;    ///< Whether the displacement limit shortened the projected substep
  Point<Patient> end;       ///< End of the substep before the projection
  Point<Patient> position;  ///< End projected out of all surfaces
};

/// Validate stage: projects the end of a substep out of the surfaces. The substep is rejected if
/// - no position outside is found,
/// - the projection is longer than a substep, so that its ends no longer bound the penetration between them,
/// - or the distance to the tip increases by more than max_distance_increase times its length.
///
/// Because of the last condition the proxy comes to rest instead of oscillating where the normals change
/// within one substep.
ValidatedStep validate_step(PairSet& pairs, const Point<Patient>& from, const Point<Patient>& end,
                            const StepConditions& conditions, const DisplacementBall& limit);

}  // namespace palpate
