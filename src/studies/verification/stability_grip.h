#pragma once

#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Mechanical model of a hand that holds a device: a single mass, or two masses coupled by the skin. SI
/// units.
struct Grip {
  double mass_kg = 0.15, damping_N_s_per_m = 2, stiffness_N_per_m = 80;
  double skin_N_per_m = 0;      ///< Stiffness between the device and the hand's mass; 0: rigid
  double skin_N_s_per_m = 0.5;  ///< Damping of the same
};

/// A simulated hand as a Grip.
Grip grip_of(const PlantHand& hand);

/// An impact on a wall, followed by a hold, through the real tick.
struct GripCase {
  PlantDevice device;
  Grip grip;
  double stiffness_N_per_mm = 1;             ///< Rendered at the device
  double viscosity_N_s_per_mm = 0;           ///< Viscosity inside the wall, rendered at the device
  double max_damping_N_s_per_mm = kNoValue;  ///< As in DeviceParameters
  double rate_hz = 1000;
  double delay_s = 1e-3;
  bool controller = true;
  std::optional<double> reported_s = {};  ///< Delay that the tick is informed of; empty: delay_s
  /// A physical device that declares only its rate: the tick assumes conservative values
  bool states_nothing = false;
  double press_N = 1;       ///< Force at rest
  double impact_m_s = 0.1;  ///< Impact speed of the hand, which then holds its target depth
  /// Thrown at the wall: nobody holds the device, and the grip is its mass only
  bool free = false;
  double time_s = 4;  ///< Duration after the impact
};

/// Result of a GripCase.
struct GripResult {
  double swing_mm = 0;      ///< Peak-to-peak motion of the true tip in the last second
  double crossings_hz = 0;  ///< Rate of upward crossings of the mean in that second
  double force_N = 0;       ///< Mean force in that second
  /// Speed a millimetre before the wall at the first rebound, divided by the impact speed
  double rebound = 0;
  double settled_s = 0;  ///< Time from the impact until the motion stays within 0.2 mm over any 100 ms
};
GripResult hold_wall(const Model& wall, const GripCase& grip_case);

/// Figures of hands with less damping than the documented ones, of one mass and of two, and of a free tap. At
/// 1 kHz with a delay of 1 ms, of which the tick is informed or not, at the stiffness recommended for the
/// device; the tap also with 3 ms, for a physical device that declares only its rate. Hands with skin at 1
/// kHz, 500 and 250 Hz with up to 4 ms of delay, and the energy generated in 15 s of exploration. Errors:
/// kInterrupted.
Result<std::vector<Figure>> grip_figures(const Progress& progress);

}  // namespace palpate
