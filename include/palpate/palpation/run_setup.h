#pragma once

#include <string>
#include <vector>

#include "palpate/device/simulated_device.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/palpation.h"
#include "palpate/servo/servo.h"

/// What a run with the simulated hand needs, on whichever clock.
namespace palpate {

/// A script with the device and hand that it names, the model ready for every method that it takes, and the
/// parameters of the first tick.
struct RunSetup {
  std::shared_ptr<const Model> model;
  Script script;  ///< with the seed and rate of the options
  PlantDevice device;
  PlantHand hand;
  WorkspaceSettings workspace;
  Parameters parameters;
  /// Least of device, user and scene limit, N.
  double limit_N = 0;
  /// Known before the first tick, a sentence each: stiffness that no hand holds, presses that the limit or
  /// the tissue cannot give.
  std::vector<std::string> trouble;
  RecordedTask task = {};
};

/// Errors: an unknown device or hand, with the script's line; those of with_methods.
Result<RunSetup> set_up_run(const LoadedScene& loaded, const Script& script, const SimulationOptions& options,
                            const Progress& progress);

/// What a run needs whose tips persons lead, by a pointer or a device: the model, the parameters but those of
/// the devices, the rate of a loop that has its own clock. Neither stiffness nor heat limits the force yet.
Result<RunSetup> set_up_led_run(const LoadedScene& loaded, const SimulationOptions& options,
                                const Progress& progress);

RecordingHeader header_of_run(const LoadedScene& loaded, const RunSetup& setup);

/// A structure that is to be held, and the forces with which a script presses it; none: it is only touched.
struct HoldAsked {
  LabelId structure = 0;
  std::vector<double> forces_N = {};
};

/// Longest unbroken hold (HoldFigure::held_s), mean and peak of one structure, from every tick in order.
class HoldMeter {
 public:
  HoldMeter(const Model& model, const HoldAsked& asked);
  void see(const TickRecord& record);
  HoldFigure figure() const;

 private:
  HoldFigure figure_;
  std::vector<double> forces_N_;    // that are asked for; none: any
  std::vector<double> unbroken_s_;  // of each
  double sum_N_ = 0;
  std::uint64_t ticks_ = 0;
};

}  // namespace palpate
