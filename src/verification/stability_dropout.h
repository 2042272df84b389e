#pragma once

#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Who sends the force from the first fresh pose on.
enum class Return {
  kTick,
  /// nobody could do more than a wall does: all of its force at once
  kAtOnce,
  /// nobody could do more without a kick: kMaxKick_N more in each tick, whatever the wall asks for
  kWithoutKick,
};
inline constexpr double kMaxKick_N = 0.2;

/// A hand that presses on flat_wall(), and poses that fail to come for a while, at 1 kHz through the real
/// tick.
struct Dropout {
  PlantDevice device;
  PlantHand hand;
  double stiffness_N_per_mm = 1;  ///< that the hand feels
  double delay_s = 0;
  double time_s = 0.02;       ///< for which no fresh pose comes
  double press_N = 1;         ///< that the hand bears besides the device's Coulomb friction
  Return by = Return::kTick;  ///< another one shows how little the tip could sink; only sink_mm is told then
};

/// What the hand notices of it.
struct DroppedOut {
  double before_N = 0;  ///< that the wall gave
  double sink_mm = 0;   ///< how far the true tip fell
  double back_s = 0;    ///< from the first fresh pose until the wall gives four fifths of that, for good
  double kick_N = 0;    ///< largest growth of the force in a tick of the first 100 ms
  bool silent = false;  ///< nothing was sent on poses of 10 ms and more
};
DroppedOut drop_out(const Model& wall, const Dropout& dropout);

/// Of 20 ms at 1 N, at what is recommended for 1 ms of delay, every device and documented hand, and how
/// little each could sink while a pose of 10 ms and more gives no force. Errors: kInterrupted.
Result<std::vector<Figure>> dropout_figures(const Progress& progress);

}  // namespace palpate
