#pragma once

#include <cstdint>
#include <memory>

#include "palpate/contact/model.h"

namespace palpate {

/// Values of Model::thin_voxels.
inline constexpr std::uint8_t kNoThinBone = 0, kThinBone = 1;
/// Voxel of no structure in CuttingEnergy next to thin bone alone, whose surface may reach into it.
inline constexpr std::uint8_t kNextToThinBone = 2;

/// Model::thin_voxels: voxels of the structures in CuttingEnergy that no ball of kCuttingSettings.thick_mm
/// diameter within the structures' surfaces covers, such as walls between air cells, trabeculae and sharp
/// edges. There a surface between voxels is too coarse to measure volume, and the burr's law counts the
/// voxels themselves.
/// @param model  with surfaces, before any removal
/// @return null if there are none
std::shared_ptr<const Bricks<std::uint8_t>> thin_voxels_of(const Model& model);

}  // namespace palpate
