#pragma once

#include <cstdint>
#include <filesystem>

#include "palpate/base/result.h"
#include "palpate/volume/label_map.h"
#include "palpate/volume/volume.h"

/// Writes volumes and labels as NRRD, MetaImage or NIfTI.
namespace palpate {

/// Writes a volume in the format of the file's extension, compressed; NRRD and MetaImage in LPS, NIfTI in RAS
/// as its standard requires, so that other software obtains the same geometry. The file appears complete or
/// not at all (a temporary is renamed). Errors: kOutput.
Result<void> write_volume(const std::filesystem::path& file, const Volume<float>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint8_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::uint16_t>& volume);
Result<void> write_volume(const std::filesystem::path& file, const Volume<std::int16_t>& volume);
/// Writes labels; the extension .seg.nrrd stores names, colours and layers in Slicer's fields. Errors:
/// several layers in any other format.
Result<void> write_labels(const std::filesystem::path& file, const LabelMap& labels);

}  // namespace palpate
