#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "volume_io/labels/anatomy_words.h"

namespace palpate::volume_io {

struct AdjacentTable {
  std::filesystem::path file;
  bool has_own_name = false;                  ///< True for the label map's own name.
  std::vector<std::filesystem::path> others;  ///< Other volumes in the folder to which the table may belong.
};
/// Table of names in the folder of a label map: one of the same name, otherwise the single .ctbl or .tsv in
/// the folder; nullopt if there is none or more than one.
/// @param scan  file that is not a label map
std::optional<AdjacentTable> find_adjacent_table(const std::filesystem::path& file,
                                                 const std::optional<std::filesystem::path>& scan);

/// Structure name by the file name: the words that are known to be anatomy; empty for "labels", "seg_01" or a
/// patient's name.
AnatomyInName name_of_mask(const std::filesystem::path& file);

}  // namespace palpate::volume_io
