#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "volume_io/formats/itk_io.h"

namespace palpate::testing {

/// Geometry as read by ITK's own reader; nullopt if ITK rejects the file. A volume with fewer than three axes
/// lies in the plane of the first axes.
std::optional<volume_io::ItkGrid> itk_grid_of(volume_io::ItkFormat format, const std::filesystem::path& file);

/// All voxel values as read by ITK's own reader, the reference for palpate's reader; nullopt if ITK cannot
/// read the file.
std::optional<std::vector<double>> itk_voxels(volume_io::ItkFormat format, const std::filesystem::path& file);

}  // namespace palpate::testing
