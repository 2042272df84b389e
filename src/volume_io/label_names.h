#pragma once

#include <filesystem>
#include <optional>
#include <string>

namespace palpate::volume_io {

/// The table of names that belongs to `file`: one of the same name, or else the single .ctbl or .tsv in its
/// folder; nothing when there is none, or more than one.
std::optional<std::filesystem::path> table_beside(const std::filesystem::path& file);

/// What a file of one structure is called after: its name without ending; nothing for names that say nothing
/// of a structure ("labels", "seg_01").
std::optional<std::string> name_of_mask(const std::filesystem::path& file);

}  // namespace palpate::volume_io
