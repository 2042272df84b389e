#pragma once

#include <filesystem>
#include <optional>

namespace palpate::volume_io {

/// The single .ctbl or .tsv in the folder of `file`; nothing when there is none or more than one.
std::optional<std::filesystem::path> only_table_beside(const std::filesystem::path& file);

}  // namespace palpate::volume_io
