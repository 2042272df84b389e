#pragma once

#include <filesystem>
#include <string>

#include "palpate/haptics.h"
#include "palpate/progress.h"
#include "palpate/recording.h"

namespace palpate {

/// One self-contained HTML page about a run: sections through each contact, force, depth and speed over
/// time, contact per structure, counts of the safety stage, how a loop on the real clock kept time, where it
/// came from. Read in memory that does not depend on the run's length. No network, no path and no header text
/// of the input files in it.
Result<std::string> report_html(const RecordingSource& recording, const Model& model,
                                const Progress& progress = {});
/// Written whole or not at all.
Result<void> write_report(const std::filesystem::path& file, const RecordingSource& recording,
                          const Model& model, const Progress& progress = {});

}  // namespace palpate
