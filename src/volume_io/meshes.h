#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "volume_io/mesh.h"
#include "volume_io/structure_files.h"

/// Surfaces as segmentations: a file of them, or a folder with a file for each structure, read by a process
/// of its own as DICOM is (dicom.h, whose messages these are).
namespace palpate::volume_io {

/// What format a plain file is a surface of, by its first bytes and its name.
std::optional<MeshFormat> mesh_format_of(const std::filesystem::path& file);
/// Whether it is a file of meshes, or a folder in which such files stand and neither volumes nor DICOM.
bool is_meshes(const std::filesystem::path& file);

/// @param file  of which is_meshes() holds
/// @param scan  whose grid the voxels are made on; null: one of their own
Result<LabelReader> open_meshes(const std::filesystem::path& file, const GridGeometry* scan,
                                const MeshPlacing& placing, const Progress& progress);

}  // namespace palpate::volume_io
