#pragma once

#include <filesystem>
#include <optional>

#include "volume_io/structure_files.h"

/// Images as slices of a volume: a folder of them in the natural order of their names, or the pages of a
/// TIFF. Read by a confined process (structure_files.h).
namespace palpate::volume_io {

/// Interpretation of colour images.
enum class ImageColours {
  kLabels,  ///< Each distinct colour is a structure, black is background.
  kGrey,    ///< The luminance is the value of a scan.
};

/// VolumeHeader::format of labels by colour.
inline constexpr const char* kColouredPictures = "pictures in colours";

/// Natural order: compares numbers within names by value, so that "slice2.png" precedes "slice10.png".
bool natural_less(std::string_view one, std::string_view other);

/// Starts a reader process for a stack of images.
/// @pre is_image_stack(file)
/// Errors: no spacing, which images do not contain; images of different sizes or kinds, naming two of them; a
/// single image; too many colours, with their number; a damaged image, with its name; interrupted.
Result<LabelReader> open_image_stack(const std::filesystem::path& file,
                                     const std::optional<Eigen::Vector3d>& spacing_mm, ImageColours colours,
                                     const Progress& progress);

}  // namespace palpate::volume_io
