#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace palpate::app {

/// An input, and all that stands in it where it is a folder.
void add_input(const std::filesystem::path& input, std::vector<std::filesystem::path>& files);

/// The files that `what` stands for, none of which an output may replace: a volume; a scene file and the
/// volumes and names that it gives; those of a data set as far as they are on this machine; none for an empty
/// text.
std::vector<std::filesystem::path> input_files(const std::string& what);

}  // namespace palpate::app
