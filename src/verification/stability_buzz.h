#pragma once

#include <vector>

#include "palpate/scene/scene.h"
#include "palpate/stability/hold.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Two plates of bone 3 mm apart, perpendicular to the patient's x axis: |x| from 1.5 to 16.5 mm, for every
/// force method on which the preparation is felt.
Result<std::shared_ptr<const Model>> two_plates(double stiffness_N_per_mm, PreparationMethod preparation,
                                                const Progress& progress = {});

/// All methods for the union Gaussian. For ramps those that read the field: the spheres and the proxy have
/// ways of their own from the labels, whatever the preparation.
std::vector<ForceMethodInfo> methods_on(PreparationMethod preparation);

/// A place on the plates: the hand goes evenly from one point to the other, and rests.
struct HeldPlace {
  const char* name;
  Point<Patient> from, at;
};
/// Between the plates, at the outer wall of one at 1 N, and 5 mm inside it.
std::vector<HeldPlace> places_on_plates(const Model& model, ForceMethod method, const PlantHand& hand);

/// The figures of every method and preparation at those places with both devices and both grips, at 1 kHz
/// with 1 ms of delay. Errors: kInterrupted.
Result<std::vector<Figure>> buzz_figures(const Progress& progress);

}  // namespace palpate
