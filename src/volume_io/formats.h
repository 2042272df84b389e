#pragma once

#include <span>
#include <string_view>

#include "volume_io/file_kind.h"
#include "volume_io/itk_io.h"
#include "volume_io/voxel_source.h"

namespace palpate::volume_io {

/// One file format. A new one is a file of its own with its inspect function, and a line in formats.cc.
struct Format {
  const char* name;
  std::span<const std::string_view> endings;  ///< in lower case, with their dot
  /// Understands the header, checks everything in it that can be wrong, reads no voxel.
  Result<VolumeFile> (*inspect)(const std::filesystem::path& file);
  ItkFormat writer;
  std::span<const std::string_view> written;  ///< endings that it is written under: one file each
};

/// The format that a file's name asks for.
Result<const Format*> format_of(const std::filesystem::path& file);
/// Inspects a file by its format. Errors: missing, not a plain file, unknown format, and all of inspect.
Result<VolumeFile> inspect(const std::filesystem::path& file);

bool has_ending(const std::filesystem::path& file, std::string_view ending);

/// What the file holds by its first bytes, through gzip where it is compressed so; nothing for a text, what
/// is not known and what cannot be read.
std::optional<FileKind> content_of(const std::filesystem::path& file);

Result<VolumeFile> inspect_nrrd(const std::filesystem::path& file);
Result<VolumeFile> inspect_nifti(const std::filesystem::path& file);
Result<VolumeFile> inspect_metaimage(const std::filesystem::path& file);

/// The geometry as ITK reads it, checked. `dims` are ours; ITK reading others is an error.
Result<GridGeometry> itk_geometry(ItkFormat format, const std::filesystem::path& file,
                                  const std::array<int, 3>& dims);

/// The geometry if it can be one: finite, positive spacing, directions that span space.
Result<GridGeometry> checked(const GridGeometry& geometry, const std::string& source);

}  // namespace palpate::volume_io
