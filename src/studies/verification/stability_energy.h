#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/contact/model.h"
#include "palpate/device/simulated_device.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// Ball of bone of radius kBallRadius_mm and 1 N/mm, for the trilinear method and the proxy. Centred in the
/// volume, at the patient's origin.
Result<std::shared_ptr<const Model>> exploration_ball(const Progress& progress = {});
inline constexpr double kBallRadius_mm = 12;

/// Deformable ball of the same size around a ball of bone of 5 mm, and a tool of 3 mm radius; for the proxy.
Result<std::shared_ptr<const Model>> soft_ball(double youngs_modulus_kPa, TissueLaw law,
                                               const Progress& progress = {},
                                               const Relaxation& relaxation = {});

/// Random exploration of the ball through the real tick: the hand moves smoothly between random targets
/// inside and outside the ball, at speeds of manual palpation. Friction and viscosity are off.
struct Exploration {
  PlantDevice device;
  PlantHand hand;
  ForceMethod method = ForceMethod::kProxy;
  double stiffness_N_per_mm = 1;  ///< Rendered at the device (the scene's stiffness times the force gain);
                                  ///< for deformable tissue the maximum
  double delay_s = 0;
  std::optional<double> reported_s = {};  ///< Delay that the tick is informed of; empty: delay_s
  bool controller = true;
  bool turning = false;  ///< Whether the object rotates as well
  bool flat = false;     ///< On flat_wall() instead of the ball
  /// The hand presses on the plane with 1 N and holds, instead of exploring.
  bool presses = false;
  /// The tool is a burr with its motor running; swept tissue is removed every 20 ms.
  bool cuts = false;
  /// The burr's vibration and kick are rendered.
  bool vibrates = false;
  /// For a pressing hand: time at which the motor stops; the hand then presses with 1 N on the bottom of the
  /// hole. At time_s or later: it does not stop.
  double motor_stops_s = 1e9;
  double rate_hz = 1000;
  double jitter = 0;  ///< Relative random variation of the tick length; 0 if there is a delay
  double time_s = 60;
  std::uint64_t seed = 1;
};

/// Energy balance of the virtual environment. The energy is the actual one: work of the force that acted
/// along the path of the true tip, relative to the object.
struct EnergyBalance {
  /// Minimum of the net energy supplied by the hand; negative: the environment generated energy
  double min_mJ = 0;
  double last_mJ = 0;  ///< At the end
  double largest_force_N = 0;
  double deepest_mm = 0;  ///< Maximum depth of the true tip below the ball's surface
  /// For a pressing hand: peak-to-peak motion of the true tip normal to the plane, relative to its mean over
  /// 40 ms, in the second half of the run.
  double swing_mm = 0;
  double pressed_N = 0;  ///< Mean of the acting force in the same period
  int contacts = 0;      ///< Number of contacts
  double damped = 0;     ///< Fraction of ticks in contact in which the passivity controller was active
};
/// Simulates an exploration on a virtual clock through tick().
/// @param object  exploration_ball(), soft_ball(), or flat_wall() if exploration.flat; with its tool
EnergyBalance simulate_exploration(const Model& object, const Exploration& exploration);

/// Figures of a minute of exploration, with and without the passivity controller, at the recommended
/// stiffness of every delay, and without delay on a rotating object and at twice that stiffness. Errors:
/// kInterrupted.
Result<std::vector<Figure>> energy_figures(const Progress& progress);

}  // namespace palpate
