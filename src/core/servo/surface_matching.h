#pragma once

#include <array>

#include "palpate/servo/servo.h"

/// Matches the surfaces of a new model version to those of the one before, so that proxies stay on surfaces
/// that did not change.
namespace palpate {

/// Correspondence of each surface of a model to a surface of the version before.
using SurfaceMatches = std::array<SurfaceCorrespondence, kMaxSurfaces>;

/// Matches the surfaces of `model` to `last_surfaces`; returns one entry per surface of `model`. A structure
/// is first compared at its previous index, so that an edit that reorders nothing costs one comparison per
/// surface.
std::span<const SurfaceCorrespondence> match_surfaces(const Model& model,
                                                      const SessionState::Surfaces& last_surfaces,
                                                      SurfaceMatches& storage);

/// Stores the surfaces of `model` in `last_surfaces`.
void store_surfaces(const Model& model, SessionState::Surfaces& last_surfaces);

}  // namespace palpate
