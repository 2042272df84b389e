#pragma once

#include <array>

#include "palpate/servo/servo.h"

namespace palpate {

/// Where each surface of a model was among those of the version before.
using SurfacesBefore = std::array<SurfaceBefore, kMostSurfaces>;

/// Compares a model's surfaces with those that are remembered; one for each of the model's. A structure is
/// looked for in its old place first, so that an edit that moves none costs one look for each.
std::span<const SurfaceBefore> find_before(const Model& model, const SessionState::Surfaces& remembered,
                                           SurfacesBefore& before);

/// Remembers them in place of what was there.
void remember_surfaces(const Model& model, SessionState::Surfaces& remembered);

}  // namespace palpate
