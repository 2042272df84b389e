#pragma once

#include <filesystem>
#include <vector>

#include "volume_io/structure_files.h"

/// A folder with a mask for each structure, as TotalSegmentator writes them: volumes on one grid. The
/// structure is where a mask is not 0. Read by a process of its own (structure_files.h).
namespace palpate::volume_io {

/// The volumes that stand in a folder, by their names, in order; of two files one. Links that lead out of it,
/// and may not, are none.
std::vector<std::filesystem::path> volumes_in(const std::filesystem::path& folder);
/// Whether it is a folder in which volumes stand, two at least, and no DICOM.
bool is_masks(const std::filesystem::path& folder);

/// @param folder  of which is_masks() holds
/// Errors: a file that is no mask (a scan, several labels), has another grid than the first, or its voxels in
/// another file; interrupted.
Result<LabelReader> open_masks(const std::filesystem::path& folder, const Placing& placing,
                               const Progress& progress);

}  // namespace palpate::volume_io
