#pragma once

#include <functional>
#include <optional>
#include <string>

#include "apps/command/console.h"
#include "palpate/session/explore.h"

namespace palpate::app {

/// Notes the rendered stiffness of each tissue if the workspace makes it differ from that of the scene.
void note_rendered_stiffness(const LoadedScene& loaded, Console& console);

/// Returns a function that prints notes at the first call, then the live line. It reports once that a
/// recording ended, and each method that could not be prepared.
/// @param realtime_requested  whether a warning is due if the loop has no real-time scheduling
/// @param address             URL of the page; empty: none
/// @param printed_warnings    collects the warnings printed at the start, one per line
/// @param tracked             set to the latest error estimate of a tracked tip
/// All referenced objects have to outlive the function.
std::function<void(const ExploreStatus&)> explore_status_printer(bool realtime_requested,
                                                                 const std::string& address,
                                                                 std::string& printed_warnings,
                                                                 std::optional<ViewedNavigation>& tracked,
                                                                 Console& console);

}  // namespace palpate::app
