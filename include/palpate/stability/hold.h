#pragma once

#include <filesystem>
#include <span>
#include <vector>

#include "palpate/base/progress.h"
#include "palpate/device/simulated_device.h"
#include "palpate/haptics/haptics.h"

/// How restless a tip is that a simulated hand holds still. See
/// docs/results/between-bones.md and docs/results/stability.md, "Buzz".
namespace palpate {

/// How restless a held tip is, over a second.
struct Buzz {
  double peak_to_peak_um = 0;  ///< the farthest that it gets along an axis of the device
  double rms_um = 0;           ///< 20 ... 500 Hz
  double dominant_Hz = 0;      ///< of all frequencies, the one with most power; 0 where the tip rests
  double force_N = 0;          ///< in the mean, of whatever direction: 0 is rest without contact
  double energy_mJ = 0;        ///< that the virtual world gave out: force that acted times way of the tip
};

/// Where a tip is held, and by whom.
struct Hold {
  PlantDevice device;
  PlantHand hand;
  ForceMethod method = ForceMethod::kTrilinear;
  double rate_hz = 1000;  ///< kLowestHold_hz ... kHighestHold_hz
  double delay_s = 1e-3;  ///< from a command to its force, 0 ... SimulatedDevice::kMostDelay_s
  double force_gain = 1;  ///< the hand feels every stiffness times this
  Point<Patient> from;    ///< the hand goes from there,
  Point<Patient> at;      ///< evenly within kLead_s, to this place, and rests for kHeld_s
};
inline constexpr double kLead_s = 1, kHeld_s = 2;
inline constexpr double kLowestHold_hz = 250, kHighestHold_hz = 10000;

/// What became of it.
struct HeldTip {
  ForceMethod method = ForceMethod::kTrilinear;
  Buzz buzz;  ///< of the last second
  double encoder_step_um = 0;
  bool inside = false;  ///< at the end the proxy still waits: the hold began inside (kFlagInside)
  bool wedged = false;  ///< at the end the tool is wider than the gap that it is in (kFlagWedged)
  double rate_hz = 0;
  std::vector<Point<Patient>>
      tip;  ///< the true one at each tick's begin while the hand rests, and at the end

  /// Within two encoder steps.
  bool quiet() const { return buzz.peak_to_peak_um <= 2 * encoder_step_um; }
};

/// Holds through the real tick, with friction, viscosity and all limits as in a palpation and the object
/// unturned. Deterministic.
/// @param model  is prepared for the method (Model::has)
/// Errors: kBadInput for a rate or a delay out of range; kInterrupted.
Result<HeldTip> hold_tip(const Model& model, const Hold& hold, const Progress& progress = {});

/// A picture of held tips, as a self-contained SVG: each one's way over time in a panel of its own, all on
/// one scale, along the direction in which the most restless one moves most, with a band of two encoder
/// steps.
/// @param tips     at least one, of one rate, device and hand
/// @param heading  what they were held with, in words
/// Errors: kOutput. Written whole or not at all.
Result<void> write_hold_picture(const std::filesystem::path& file, std::span<const HeldTip> tips,
                                const std::string& heading);

}  // namespace palpate
