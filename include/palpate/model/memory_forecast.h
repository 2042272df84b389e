#pragma once

#include <cstdint>

#include "palpate/model/make_model.h"

/// Estimates of a model's memory before it is built.
namespace palpate {

/// Memory in bytes: permanent after a model is built, and peak while it is being built.
struct MemoryForecast {
  std::uint64_t labels = 0;    ///< Label bricks; exact
  std::uint64_t field = 0;     ///< Field of the direct methods; 0 without it
  std::uint64_t surfaces = 0;  ///< Surfaces of the proxy, with the owners of common ones; 0 without it
  // peaks, not counting the label bricks and the input
  std::uint64_t peak_of_field = 0;  ///< Peak while the field is made; 0 without it
  std::uint64_t peak = 0;           ///< Peak of the whole build

  /// Memory of the finished model.
  std::uint64_t permanent() const { return labels + field + surfaces; }
};

/// Parts of a model that will be prepared.
struct ForecastOptions {
  bool proxy = true;   ///< Surfaces of the proxy
  bool field = false;  ///< Field of the direct methods
};

/// Estimates from the geometry and from each structure's number of voxels and faces between voxels. Fields
/// and surfaces store bricks only where they vary: near boundaries, whose area follows from the faces.
/// @param parts  labels, tissues, tools and no-go regions; the labels stay in memory
/// Errors: those of ModelPreparation::touching_pairs; kBadInput for more surfaces than the proxy supports.
Result<MemoryForecast> forecast_memory(const ModelParts& parts, const ForecastOptions& options,
                                       const ModelPreparation& preparation = {},
                                       const Progress& progress = {});

/// Memory of a field of inward ramps in addition to the rest of its model, bytes.
struct FieldMemory {
  std::uint64_t permanent = 0;  ///< The finished field
  std::uint64_t peak = 0;       ///< Peak while it is made
};
/// Estimate of what with_ramp_field() needs.
FieldMemory memory_of_ramp_field(const Model& model);

/// Peak memory of rebuilding a model's surfaces for the proxy, in addition to its existing ones.
Result<std::uint64_t> memory_of_surfaces(const Model& model, const ModelPreparation& preparation = {},
                                         const Progress& progress = {});

}  // namespace palpate
