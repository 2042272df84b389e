#pragma once

#include <cstdint>

namespace palpate {

/// Encoding of stored normals. Octahedral: the unit sphere unfolded onto a square (Cigolle et al. 2014, "A
/// Survey of Efficient Representations for Independent Unit Vectors"); of the four codes around a direction
/// the nearest is chosen.
enum class NormalEncoding : std::uint8_t {
  kBytes,         ///< Three signed bytes, one per component, as published
  kOctahedral16,  ///< Two signed bytes
  kOctahedral24,  ///< Two signed 12-bit numbers
};

}  // namespace palpate
