#pragma once

#include <cstdint>

#include "palpate/model/make_model.h"

/// How much memory a model will take, before it is made.
namespace palpate {

/// Bytes. What stays once a model is made, and the most at a time while it is.
struct MemoryForecast {
  std::uint64_t labels = 0;    ///< in bricks; known, not estimated
  std::uint64_t field = 0;     ///< of the direct methods
  std::uint64_t surfaces = 0;  ///< of the proxy, with who owns what is common; 0 without it
  // the most at a time, beside the labels' bricks and what was read
  std::uint64_t making_field = 0;
  std::uint64_t peak = 0;  ///< of all

  std::uint64_t stays() const { return labels + field + surfaces; }
};

/// From the geometry and from how many voxels, and faces between voxels, each structure has. Fields and
/// surfaces are kept where they change: near borders, of which the faces tell how large they are.
/// @param parts  with labels, tissues and what they apply to; its labels stay
/// @param proxy  whether it is to be felt by the proxy, too
/// Errors: those of Preparing::touching_pairs, more surfaces than the proxy takes.
Result<MemoryForecast> forecast_memory(const ModelParts& parts, bool proxy, const Preparing& preparing = {},
                                       const Progress& progress = {});

/// Likewise the most at a time of making a model's surfaces for the proxy anew, beside those that it has.
Result<std::uint64_t> memory_of_surfaces(const Model& model, const Preparing& preparing = {},
                                         const Progress& progress = {});

}  // namespace palpate
