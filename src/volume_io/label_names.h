#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "volume_io/anatomy_words.h"

namespace palpate::volume_io {

/// The table of names that belongs to `file`: one of the same name, or else the single .ctbl or .tsv in its
/// folder; nothing when there is none, or more than one.
std::optional<std::filesystem::path> table_beside(const std::filesystem::path& file);

/// What a file of one structure is called after: the words of its name that are known to be anatomy; none in
/// "labels", "seg_01" or the name of a patient.
AnatomyInName name_of_mask(const std::filesystem::path& file);

}  // namespace palpate::volume_io
