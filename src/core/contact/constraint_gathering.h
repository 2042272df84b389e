#pragma once

#include "contact/near_surfaces.h"
#include "palpate/geometry/geometry.h"

/// Gather stage of a substep: the half-spaces of the surfaces that the tool touches.
namespace palpate {

/// Replaces the constraints by the tangent planes of all surfaces nearer than ProxyFeel::skin_mm.
/// @param proxy  position of the tip's proxy
/// @return if there are none, the distance within which there is no surface; otherwise infinite
double gather_constraints(PairSet& pairs, const Point<Patient>& proxy, ContactConstraints& constraints);

/// Adds the tangent plane of every surface that the tool would penetrate at the end of a substep.
/// @return whether there is any
bool add_penetrated(PairSet& pairs, const Point<Patient>& end, ContactConstraints& constraints);

/// Whether the tool at a position penetrates any surface by more than ProxyFeel::substep_penetration_mm.
bool penetrates_any(PairSet& pairs, const Point<Patient>& at);

}  // namespace palpate
