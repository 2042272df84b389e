#include "palpate/model/stiffness_layers.h"

#include <algorithm>

#include "palpate/base/check.h"

namespace palpate {

std::vector<StiffnessRange> stiffness_layers(std::vector<double> stiffnesses, int largest) {
  PALPATE_CHECK(largest >= 1);
  std::sort(stiffnesses.begin(), stiffnesses.end());
  std::vector<StiffnessRange> layers;
  for (const double stiffness : stiffnesses) {
    if (layers.empty() || stiffness > kSameStiffness * layers.back().min_N_per_mm)
      layers.push_back({stiffness, stiffness});
    layers.back().max_N_per_mm = stiffness;
  }
  while (layers.size() > static_cast<std::size_t>(largest)) {
    std::size_t closest = 0;
    const auto error_with_next = [&](std::size_t n) {
      return StiffnessRange{layers[n].min_N_per_mm, layers[n + 1].max_N_per_mm}.error();
    };
    for (std::size_t n = 1; n + 1 < layers.size(); ++n)
      if (error_with_next(n) < error_with_next(closest)) closest = n;
    layers[closest].max_N_per_mm = layers[closest + 1].max_N_per_mm;
    layers.erase(layers.begin() + static_cast<std::ptrdiff_t>(closest) + 1);
  }
  return layers;
}

}  // namespace palpate
