#pragma once

#include <string>
#include <vector>

#include "apps/command/console.h"
#include "palpate/session/explore.h"

namespace palpate::app {

/// Prints touches, holds, timing and summary of a session.
/// @param pointer  whether the tip was led by a viewer's pointer, which counts as at rest while it is not
/// pressed
void print_explore_result(const ExploreResult& result, bool pointer);
/// Prints the error estimate at the last position of the tip.
void print_tip_error(const ViewedNavigation& navigation);
/// Prints the title and figures of each run.
void print_runs(const std::vector<FinishedRun>& runs, const TrainingOptions& training);
/// Warns of problems that are not among `printed_warnings`. Limits the number of warnings, because a
/// repeating script causes the same problems in each repetition.
void warn_of_problems(std::vector<std::string> problems, const std::string& printed_warnings,
                      Console& console);

}  // namespace palpate::app
