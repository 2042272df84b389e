#include <algorithm>

#include "palpate/preparation/preparation.h"

namespace palpate {

namespace {

/// The weight of every possible voxel value of one layer.
std::vector<std::uint8_t> weight_by_value(const LabelMap& labels, int layer,
                                          const std::vector<std::uint8_t>& weights) {
  const auto weight_of = [&](std::size_t id) { return id < weights.size() ? weights[id] : std::uint8_t{0}; };
  // a value that no segment claims is its own id
  std::vector<std::uint8_t> by_value(std::size_t{1} << 16);
  for (std::size_t value = 0; value < by_value.size(); ++value) by_value[value] = weight_of(value);
  for (const Segment& segment : labels.segments) {
    if (segment.layer == layer) by_value[segment.value] = weight_of(segment.id);
  }
  return by_value;
}

}  // namespace

Volume<std::uint8_t> weigh_labels(const LabelMap& labels, const std::vector<std::uint8_t>& weights) {
  Volume<std::uint8_t> weighed(labels.geometry());
  for (std::size_t layer = 0; layer < labels.layers.size(); ++layer) {
    const auto by_value = weight_by_value(labels, static_cast<int>(layer), weights);
    const std::vector<LabelId>& voxels = labels.layers[layer].voxels();
    for (std::size_t n = 0; n < voxels.size(); ++n) {
      weighed.voxels()[n] = std::max(weighed.voxels()[n], by_value[voxels[n]]);
    }
  }
  return weighed;
}

}  // namespace palpate
