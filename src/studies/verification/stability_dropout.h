#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Force after the first fresh pose.
enum class ReturningForce {
  kByTick,       ///< As the tick computes it
  kAtOnce,       ///< Ideal: the whole force of the wall at once
  kWithoutKick,  ///< Ideal: increases by at most kMaxKick_N per tick
};
inline constexpr double kMaxKick_N = 0.2;

/// A hand that presses on flat_wall() and an interruption of the poses, at 1 kHz through the real tick.
struct Dropout {
  PlantDevice device;
  PlantHand hand;
  double stiffness_N_per_mm = 1;  ///< Rendered at the device
  double delay_s = 0;
  double time_s = 0.02;  ///< Duration without fresh poses
  double press_N = 1;    ///< Force of the hand in addition to the device's Coulomb friction
  /// Other than kByTick: only sinking_mm is evaluated, a lower bound for every tick
  ReturningForce returning = ReturningForce::kByTick;
};

/// Effect of the interruption.
struct DropoutResult {
  double before_N = 0;    ///< Force of the wall before it
  double sinking_mm = 0;  ///< Drop of the true tip
  /// Time from the first fresh pose until the force stays above four fifths of before_N
  double back_s = 0;
  double kick_N = 0;    ///< Largest increase of the force in a tick of the first 100 ms
  bool silent = false;  ///< Whether no force was sent for poses that were 10 ms old or older
};
DropoutResult drop_out(const Model& wall, const Dropout& dropout);

/// Figures of an interruption of 20 ms at 1 N, at the stiffness recommended for a delay of 1 ms, for every
/// device and documented hand, with the lower bound of sinking given that poses older than 10 ms generate no
/// force. Errors: kInterrupted.
Result<std::vector<Figure>> dropout_figures(const Progress& progress);

}  // namespace palpate
