#pragma once

#include <filesystem>
#include <vector>

#include "volume_io/structure_files.h"

/// Folder with one mask per structure, as written by TotalSegmentator: volumes on one grid, where non-zero
/// voxels form the structure. Read by a confined process (structure_files.h).
namespace palpate::volume_io {

/// Volumes in a folder, ordered by name; a volume of two files is listed once. Links that leave the folder
/// are skipped unless they are allowed.
std::vector<std::filesystem::path> volumes_in(const std::filesystem::path& folder);
/// True for a folder that contains at least two volumes and no DICOM.
bool is_masks(const std::filesystem::path& folder);

/// Starts a reader process for a folder of masks.
/// @pre is_masks(folder)
/// Errors: a file that is no mask (a scan, several labels), has another grid than the first, or stores its
/// voxels in another file; interrupted.
Result<LabelReader> open_masks(const std::filesystem::path& folder, const PlacementOptions& placement_options,
                               const Progress& progress);

}  // namespace palpate::volume_io
