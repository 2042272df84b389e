#pragma once

#include <filesystem>

#include "volume_io/structure_files.h"

/// A folder with a mask for each structure, as TotalSegmentator writes them: volumes on one grid, of each
/// file's voxels those that are not 0 are the structure. Read by a process of its own (structure_files.h).
namespace palpate::volume_io {

/// Whether it is a folder in which volumes stand, two at least, and neither surfaces nor DICOM.
bool is_masks(const std::filesystem::path& folder);

/// @param folder  of which is_masks() holds
/// Errors: a file that is no mask (a scan, several labels), has another grid than the first, or its voxels in
/// another file; interrupted.
Result<LabelReader> open_masks(const std::filesystem::path& folder, const Progress& progress);

}  // namespace palpate::volume_io
