#pragma once

#include <string>
#include <vector>

#include "palpate/device/simulated_device.h"
#include "palpate/loading/loading.h"
#include "palpate/palpation/hold_meter.h"
#include "palpate/palpation/palpation.h"
#include "palpate/servo/servo.h"

/// Set-up of runs whose tips are moved by the simulated hand or by operators, on the virtual or the real
/// clock.
namespace palpate {

/// Script with its device and hand, the model prepared for every method that it uses, and the parameters of
/// the first tick.
struct RunSetup {
  std::shared_ptr<const Model> model;
  Script script;  ///< Includes the seed and rate of the options
  PlantDevice device;
  PlantHand hand;
  WorkspaceSettings workspace;
  Parameters parameters;
  /// Minimum of device, user and scene limit; N.
  double limit_N = 0;
  /// Problems known before the first tick, a sentence each: stiffness that no hand can hold stably, presses
  /// beyond what the limit or the tissue permits.
  std::vector<std::string> problems;
  RecordedTask task = {};
};

/// Sets up a run of the simulated hand.
/// @param script  none: the default script, which presses every bone and cartilage of a knee, or otherwise
///                the largest touchable structures that the tool can reach. Larger ones that it cannot reach
///                are listed in Script::limitations and `problems`, with the reason.
/// Errors: an unknown device or hand, with the line of the script; no reachable structure without a script;
/// those of prepared_with_cache.
Result<RunSetup> set_up_run(const LoadedScene& loaded, const std::optional<Script>& script,
                            const SimulationOptions& options, const Progress& progress);

/// Set-up of a run whose tips are moved by operators, with a pointer or a device: model, parameters other
/// than the devices', rate of a loop with its own clock. Limits by stiffness and heat are not applied yet.
Result<RunSetup> set_up_guided_run(const LoadedScene& loaded, const SimulationOptions& options,
                                   const Progress& progress);

/// Header of the run's recording.
RecordingHeader header_of_run(const LoadedScene& loaded, const RunSetup& setup);

}  // namespace palpate
