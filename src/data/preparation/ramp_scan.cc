#include <algorithm>
#include <cmath>

#include "palpate/preparation/preparation.h"

namespace palpate {

Volume<std::uint8_t> ramp_scan(const Volume<float>& scan, double low, double high, double weight) {
  PALPATE_CHECK(low < high);
  PALPATE_CHECK(weight >= 0 && weight <= 1);
  Volume<std::uint8_t> ramp(scan.geometry());
  const auto full = static_cast<float>(255 * weight);
  const auto from = static_cast<float>(low), per_unit = static_cast<float>(1 / (high - low));
  std::transform(scan.voxels().begin(), scan.voxels().end(), ramp.voxels().begin(), [=](float value) {
    const float part = (value - from) * per_unit;
    // the comparison is false for NaN, which therefore counts as free space
    const float clamped = part > 0 ? std::min(part, 1.0f) : 0.0f;
    return static_cast<std::uint8_t>(clamped * full + 0.5f);
  });
  return ramp;
}

}  // namespace palpate
