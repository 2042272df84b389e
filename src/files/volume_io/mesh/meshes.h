#pragma once

#include <filesystem>
#include <memory>
#include <optional>

#include "volume_io/mesh/mesh.h"
#include "volume_io/structure_files.h"

/// Surfaces as segmentations: a file, or a folder with one file per structure, read by a confined process as
/// DICOM is (same protocol as dicom.h).
namespace palpate::volume_io {

/// Surface format of a regular file, by its first bytes and its name.
std::optional<MeshFormat> mesh_format_of(const std::filesystem::path& file);
/// True for a file of meshes, or for a folder that contains such files and neither volumes nor DICOM.
bool is_meshes(const std::filesystem::path& file);

/// Starts a reader process for surfaces.
/// @pre is_meshes(file)
/// @param scan  grid on which the surfaces are rasterised; null: a grid of their own
Result<LabelReader> open_meshes(const std::filesystem::path& file, const GridGeometry* scan,
                                const MeshPlacementOptions& placement_options, const Progress& progress);

}  // namespace palpate::volume_io
