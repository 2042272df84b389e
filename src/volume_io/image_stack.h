#pragma once

#include <filesystem>
#include <optional>

#include "volume_io/structure_files.h"

/// Pictures as slices of a volume: a folder of them in the natural order of their names, or the pages of a
/// TIFF. Read by a process of its own (structure_files.h).
namespace palpate::volume_io {

/// What the colours of pictures mean.
enum class ImageColours {
  kLabels,  ///< each distinct colour is a structure, black is none
  kGrey,    ///< their luminance is a value of a scan
};

/// VolumeHeader::format of labels by colour.
inline constexpr const char* kColouredPictures = "pictures in colours";

/// Whether one name comes before another with numbers in them compared as numbers: "slice2.png" before
/// "slice10.png".
bool natural_less(std::string_view one, std::string_view other);

/// @param file  of which is_image_stack() holds
/// Errors: no spacing, which pictures do not say; pictures of different sizes or kinds, with both names; a
/// single picture; too many colours, with their number; a picture that is damaged, with its name;
/// interrupted.
Result<LabelReader> open_image_stack(const std::filesystem::path& file,
                                     const std::optional<Eigen::Vector3d>& spacing_mm, ImageColours colours,
                                     const Progress& progress);

}  // namespace palpate::volume_io
