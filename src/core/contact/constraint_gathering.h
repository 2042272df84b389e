#pragma once

#include "contact/near_surfaces.h"
#include "palpate/geometry/geometry.h"

/// Gather stage of a substep: half-space constraints of the surfaces in contact with the tool.
namespace palpate {

/// Replaces the constraints by the tangent plane of every pair whose clearance is at most
/// ProxySettings::skin_mm.
/// @param proxy  position of the tip's proxy
/// @return maximum displacement, in any direction, that reaches no surface; infinite if there are
///         constraints, which then bound the substep
double gather_constraints(PairSet& pairs, const Point<Patient>& proxy, ContactConstraints& constraints);

/// Adds the tangent plane of every pair that penetrates by more than ProxySettings::substep_penetration_mm at
/// the end of a substep.
/// @return whether there is such a pair
bool add_penetrated(PairSet& pairs, const Point<Patient>& end, ContactConstraints& constraints);

/// Whether the tool at a position penetrates any surface by more than ProxySettings::substep_penetration_mm.
bool penetrates_any(PairSet& pairs, const Point<Patient>& at);

}  // namespace palpate
