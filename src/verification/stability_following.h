#pragma once

#include <array>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// A device in a hand that presses on flat_wall(), and the loop that it is in.
struct PressingDevice {
  PlantDevice device;
  PlantHand hand;
  double stiffness_N_per_mm = 1;  ///< that the hand feels
  double rate_hz = 1000;          ///< of its clock
  double delay_s = 1e-3;          ///< of its own, from a command to its force
};

/// Two of them at 10 mm from each other on one wall, in one tick, as CompositeDriver has it: the first one's
/// clock ticks; the second one's update tells its state, sends what the last tick has left, and comes by a
/// clock that runs away from the first one's.
struct Following {
  PressingDevice owner, follower;
  double press_N = 1;            ///< of each at rest
  bool controller = true;        ///< of passivity
  bool is_delay_counted = true;  ///< the tick is told what following costs; else the device's own delay alone
};

/// What a hand notices in the last of four seconds.
struct PressedDevice {
  double swing_mm = 0;  ///< peak to peak of the true tip across the wall
  double force_N = 0;   ///< that is sent, in the mean
};
/// From a command to its force, s, of who follows: a period of each clock more.
double following_delay_s(const PressingDevice& owner, const PressingDevice& follower);
/// [0] the owner, [1] the follower.
std::array<PressedDevice, 2> press_together(const Model& wall, const Following& following);
/// A device whose own clock ticks, and nobody else's, where the owner presses.
PressedDevice press_alone(const Model& wall, const PressingDevice& pressing, bool controller = true);

/// Both devices in either place, 1 kHz and 250 Hz, in both documented grips, each as stiff as is recommended
/// for its clock and its delay; beside each the same device alone. Errors: kInterrupted.
Result<std::vector<Figure>> following_figures(const Progress& progress);

}  // namespace palpate
