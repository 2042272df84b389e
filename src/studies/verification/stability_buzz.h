#pragma once

#include <vector>

#include "palpate/scene/scene.h"
#include "palpate/stability/hold.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Two plates of bone 3 mm apart, perpendicular to the patient's x axis (|x| from 1.5 to 16.5 mm), ready for
/// every force method that uses the preparation.
Result<std::shared_ptr<const Model>> two_plates(double stiffness_N_per_mm, PreparationMethod preparation,
                                                const Progress& progress = {});

/// All methods for the union Gaussian. For ramps only those that read the field: the spheres and the proxy
/// are prepared directly from the labels.
std::vector<ForceMethodInfo> methods_on(PreparationMethod preparation);

/// A hold position on the plates: the hand moves at constant speed from one point to the other, and rests.
struct HoldPosition {
  const char* name;
  Point<Patient> from, at;
};
/// Between the plates, at the outer surface of one at 1 N, and 5 mm inside it.
std::vector<HoldPosition> hold_positions(const Model& model, ForceMethod method, const PlantHand& hand);

/// Figures of every method and preparation at those positions with both devices and both grips, at 1 kHz with
/// a delay of 1 ms. Errors: kInterrupted.
Result<std::vector<Figure>> buzz_figures(const Progress& progress);

}  // namespace palpate
