#pragma once

#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// A hand that holds a device as it may be held: of one mass, or of two with the skin between them. SI.
struct Grip {
  double mass_kg = 0.15, damping_N_s_per_m = 2, stiffness_N_per_m = 80;
  double skin_N_per_m = 0;      ///< between the device and the hand's mass; 0: they are one
  double skin_N_s_per_m = 0.5;  ///< likewise
};

/// A hand of the simulated device as a Grip.
Grip grip_of(const PlantHand& hand);

/// A wall that is met and held through the real tick.
struct GripCase {
  PlantDevice device;
  Grip grip;
  double stiffness_N_per_mm = 1;              ///< that the hand feels
  double viscosity_N_s_per_mm = 0;            ///< likewise, inside
  double max_damping_N_s_per_mm = kNotKnown;  ///< DeviceParameters
  double rate_hz = 1000;
  double delay_s = 1e-3;
  bool controller = true;
  std::optional<double> told_s = {};  ///< of it, to the tick; nothing: as it is
  bool states_nothing = false;        ///< a physical device, but its rate: a tick takes what is careful
  double press_N = 1;                 ///< at rest
  double impact_m_s = 0.1;            ///< with which the hand comes down; then it wants to go no deeper
  bool free = false;                  ///< thrown at the wall: nobody holds it, and the grip is its mass alone
  double time_s = 4;                  ///< from the touch on
};

/// What comes of it.
struct GripResult {
  double swing_mm = 0;      ///< peak-to-peak of the true tip in the last second
  double crossings_hz = 0;  ///< how often it went up through its middle in that second
  double force_N = 0;       ///< mean of it
  double rebound =
      0;  ///< speed a millimetre before the wall, the first time it is left, over that of the impact
  double settled_s = 0;  ///< from the touch on until it swings by no more than 0.2 mm within any 100 ms
};
GripResult hold_wall(const Model& wall, const GripCase& grip_case);

/// Hands with less damping than the documented ones, of one mass and of two; and a free tap. At 1 kHz with 1
/// ms of delay, told and not told, and what is recommended for the device; the tap with 3 ms, too, as a
/// physical device is felt that states nothing but its rate. Hands with skin, at 1 kHz, 500 and 250 Hz with
/// up to 4 ms of delay, and what is given out to them in 15 s of exploration. Errors: kInterrupted.
Result<std::vector<Figure>> grip_figures(const Progress& progress);

}  // namespace palpate
