#pragma once

#include <span>
#include <vector>

#include "palpate/haptics.h"
#include "palpate/progress.h"
#include "palpate/simulated_device.h"
#include "palpate/verification.h"

namespace palpate {

/// How restless a held tip is, over a second.
struct Buzz {
  double peak_to_peak_um = 0;  ///< the farthest that it gets along an axis of the device
  double rms_um = 0;           ///< 20 ... 500 Hz
  double dominant_Hz = 0;      ///< of all frequencies, the one with most power; 0 where the tip rests
  double force_N = 0;          ///< in the mean, of whatever direction: 0 is rest without contact
  double energy_mJ = 0;        ///< that the virtual world gave out: force that acted times way of the tip
};

/// Of the tip's positions, one each tick of a second, and the forces that acted from each to the next.
/// @param tip_mm   at least 2; one more than forces
Buzz buzz_of(std::span<const Eigen::Vector3d> tip_mm, std::span<const Eigen::Vector3d> force_N);

/// Two plates of bone 3 mm apart, perpendicular to the patient's x axis: |x| from 1.5 to 16.5 mm, for every
/// force method.
Result<std::shared_ptr<const Model>> two_plates(double stiffness_N_per_mm, const Progress& progress = {});

/// Where a tip is held: the hand goes evenly from one place to the other in a second, and rests.
struct HeldPlace {
  Point<Patient> from, intended;
};
/// The last second of two for which the hand rests, at 1 kHz with 1 ms of delay, through the real tick.
Buzz hold_still(const Model& model, ForceMethod method, const PlantDevice& device, const PlantHand& hand,
                const HeldPlace& place);

/// The figures of every method between the plates, at the outer wall of one
/// and 5 mm inside it. Errors: kInterrupted.
Result<std::vector<Figure>> buzz_figures(const Progress& progress);

}  // namespace palpate
