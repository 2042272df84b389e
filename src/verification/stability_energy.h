#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"
#include "palpate/verification/verification.h"

namespace palpate {

/// A ball of bone, kBallRadius_mm in radius, of 1 N/mm, for the trilinear method and the proxy. In the middle
/// of the volume, at the patient's origin.
Result<std::shared_ptr<const Model>> exploration_ball(const Progress& progress = {});
inline constexpr double kBallRadius_mm = 12;

/// A ball as large, of tissue of so many kPa that yields, around a ball of bone of 5 mm, and a tool of 3 mm
/// radius; for the proxy.
Result<std::shared_ptr<const Model>> yielding_ball(double youngs_modulus_kPa, TissueLaw law,
                                                   const Progress& progress = {},
                                                   const Relaxation& relaxation = {});

/// A random exploration of the ball through the real tick: the hand wants to be at random places in
/// and outside the ball, one after the other, and goes there smoothly, as fast as hands palpate. Friction and
/// viscosity are off.
struct Exploration {
  PlantDevice device;
  PlantHand hand;
  ForceMethod method = ForceMethod::kProxy;
  double stiffness_N_per_mm = 1;  ///< that the hand feels; of tissue that yields the most of it
  double delay_s = 0;
  std::optional<double> told_s = {};  ///< of it, to the tick; nothing: as it is
  bool controller = true;
  bool turning = false;  ///< the object turns, too
  bool flat = false;     ///< on flat_wall() and not on the ball
  /// The hand stays where it presses with 1 N on the plane, in place of exploring.
  bool presses = false;
  /// The model's tool is a burr, whose motor runs; what it sweeps is cut away every 20 ms.
  bool cuts = false;
  /// Of a hand that presses: then it stops, and the hand presses with 1 N on the ground of the hole. At
  /// time_s and above: it runs on.
  double motor_stops_s = 1e9;
  double rate_hz = 1000;
  double jitter = 0;  ///< each tick is as much shorter or longer, at random; 0 with a delay
  double time_s = 60;
  std::uint64_t seed = 1;
};

/// What the virtual world did with it. The energy is the true one: of the force that acted over the way of
/// the true tip, relative to the object.
struct ExploredEnergy {
  double min_mJ = 0;   ///< of what the hand had put in and not got back; below 0: the world gave it out
  double last_mJ = 0;  ///< at the end
  double largest_force_N = 0;
  double deepest_mm = 0;  ///< that the true tip has been below the ball's surface
  /// Of a hand that presses: the true tip's peak-to-peak across the plane beside its mean over 40 ms, in the
  /// second half of the time.
  double swing_mm = 0;
  double pressed_N = 0;  ///< mean of the force that acted meanwhile
  int contacts = 0;      ///< how often it was touched
  double damped = 0;     ///< part of the ticks in contact in which the controller acted
};
/// @param ball  exploration_ball(), or flat_wall() where it is flat; with its tool
ExploredEnergy explore_energy(const Model& ball, const Exploration& exploration);

/// The figures of a minute of exploration, with and without the controller, at the recommended stiffness of
/// every delay, and without delay on a turning object and at twice that stiffness too. Errors: kInterrupted.
Result<std::vector<Figure>> energy_figures(const Progress& progress);

}  // namespace palpate
