#pragma once

#include <filesystem>
#include <optional>
#include <vector>

#include "volume_io/itk_io.h"

namespace palpate::testing {

/// Every voxel value as ITK's own reader gives it, or nothing when it cannot: what ours is compared with.
std::optional<std::vector<double>> itk_voxels(volume_io::ItkFormat format, const std::filesystem::path& file);

}  // namespace palpate::testing
