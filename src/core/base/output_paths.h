#pragma once

#include <filesystem>
#include <string>

/// Paths of output files and of the hidden files beside them.
namespace palpate {

/// Folder that contains a file; "." for a bare name.
std::filesystem::path folder_of(const std::filesystem::path& file);

/// Target of a chain of symbolic links, whether or not it exists; other paths are returned unchanged.
std::filesystem::path end_of_links(std::filesystem::path file);

/// Common prefix of the names of a target's temporaries and lock file.
std::string hidden_prefix(const std::filesystem::path& target);

}  // namespace palpate
