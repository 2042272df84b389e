#pragma once

#include <filesystem>
#include <vector>

#include "palpate/loading/loading.h"

namespace palpate::app {

/// An input, and all that stands in it where it is a folder.
void add_input(const std::filesystem::path& input, std::vector<std::filesystem::path>& files);

/// The files of a source, none of which an output may replace: its volumes and table of names; a scene file
/// and the volumes and names that it gives; those of a data set as far as they are on this machine; none for
/// an empty target.
std::vector<std::filesystem::path> input_files(const SceneSource& source);

/// The same of the scene of a recording: those of its data set where the source has no target.
std::vector<std::filesystem::path> recorded_inputs(SceneSource source, const RecordingHeader& header);

}  // namespace palpate::app
