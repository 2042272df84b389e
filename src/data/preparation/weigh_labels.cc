#include "palpate/preparation/preparation.h"

namespace palpate {

Volume<std::uint8_t> weigh_labels(const Volume<LabelId>& labels, const std::vector<std::uint8_t>& weights) {
  Volume<std::uint8_t> weighed(labels.geometry());
  const std::vector<LabelId>& voxels = labels.voxels();
  for (std::size_t n = 0; n < voxels.size(); ++n)
    weighed.voxels()[n] = voxels[n] < weights.size() ? weights[voxels[n]] : std::uint8_t{0};
  return weighed;
}

}  // namespace palpate
