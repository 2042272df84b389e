#pragma once

#include <filesystem>
#include <vector>

#include "palpate/loading/loading.h"

namespace palpate::app {

/// Adds an input, and all files in it if it is a folder.
void add_input(const std::filesystem::path& input, std::vector<std::filesystem::path>& files);

/// Input files of a source, which no output may replace: its volumes and its table of names; a scene file
/// with the volumes and names that it refers to; the files of a data set that exist on this machine. Empty
/// for an empty target.
std::vector<std::filesystem::path> input_files(const SceneSource& source);

/// Input files of the scene of a recording: those of its data set if the source has no target.
std::vector<std::filesystem::path> recorded_inputs(SceneSource source, const RecordingHeader& header);

}  // namespace palpate::app
