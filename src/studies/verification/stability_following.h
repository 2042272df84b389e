#pragma once

#include <array>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// A device in a hand that presses on flat_wall(), and its control loop.
struct PressingDevice {
  PlantDevice device;
  PlantHand hand;
  double stiffness_N_per_mm = 1;  ///< Rendered at the device
  double rate_hz = 1000;          ///< Rate of its clock
  double delay_s = 1e-3;          ///< Latency of the device from a command to its force
};

/// Two of them 10 mm apart on one wall, in one tick, as in CompositeDriver: the owner's clock runs the tick;
/// the follower's update publishes its state and sends the command of the last tick, on a clock that drifts
/// relative to the owner's.
struct Following {
  PressingDevice owner, follower;
  double press_N = 1;      ///< Force of each at rest
  bool controller = true;  ///< Passivity controller
  /// Whether the tick is informed of the additional delay of following; otherwise only of the device's own
  bool is_delay_counted = true;
};

/// Result of one device in the last of four seconds.
struct PressResult {
  double swing_mm = 0;  ///< Peak-to-peak motion of the true tip normal to the wall
  double force_N = 0;   ///< Mean force sent
};
/// Latency from a command to its force for a follower, s: larger by a period of each clock.
double following_delay_s(const PressingDevice& owner, const PressingDevice& follower);
/// Index 0 is the owner, 1 the follower.
std::array<PressResult, 2> run_following(const Model& wall, const Following& following);
/// A single device whose clock runs the tick, at the position of the owner.
PressResult press_alone(const Model& wall, const PressingDevice& pressing, bool controller = true);

/// Figures of both devices in either role, at 1 kHz and 250 Hz, in both documented grips, each at the
/// stiffness recommended for its clock and latency, and of the same device alone. Errors: kInterrupted.
Result<std::vector<Figure>> following_figures(const Progress& progress);

}  // namespace palpate
