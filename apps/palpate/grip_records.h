#pragma once

#include <filesystem>
#include <string>

#include "palpate/device/registry.h"
#include "palpate/doctor/grip_trial.h"
#include "verb.h"

namespace palpate::app {

/// File with the results of this user's `doctor --hold` measurements on this machine: palpate/held-hands.txt
/// in the user's data folder.
std::filesystem::path grip_figures_file();
/// Stored measurements; empty if there are none. Errors: those of reading the file.
Result<GripFiguresByDevice> stored_grip_figures();
/// Copy of `known` whose drivers report the measured grip of their devices.
/// @param figures  result of stored_grip_figures()
DeviceRegistry with_grip_figures(const DeviceRegistry& known, const GripFiguresByDevice& figures,
                                 double rate_hz);

/// Implements `palpate doctor --hold NAME`; returns the exit code.
int record_grip_trial(const DeviceRegistry& known, const std::string& name, double rate_hz, bool json,
                      Console& console);

}  // namespace palpate::app
