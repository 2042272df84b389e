#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "volume_io/anatomy_words.h"

namespace palpate::volume_io {

struct TableBeside {
  std::filesystem::path file;
  bool has_own_name = false;                  ///< that of the label map
  std::vector<std::filesystem::path> others;  ///< volumes in the folder that the table may belong to as well
};
/// The table of names beside a label map: one of the same name, or else the single .ctbl or .tsv in its
/// folder; nothing when there is none, or more than one.
/// @param scan  file that is no label map
std::optional<TableBeside> table_beside(const std::filesystem::path& file,
                                        const std::optional<std::filesystem::path>& scan);

/// What a file of one structure is called after: the words of its name that are known to be anatomy; none in
/// "labels", "seg_01" or the name of a patient.
AnatomyInName name_of_mask(const std::filesystem::path& file);

}  // namespace palpate::volume_io
