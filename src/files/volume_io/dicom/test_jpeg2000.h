#pragma once

#include <cstdint>
#include <span>
#include <vector>

/// JPEG 2000 codestreams compressed by OpenJPEG, for tests of decoders. Free of OpenJPEG's types.
namespace palpate::test {

struct Jpeg2000Coding {
  int bits = 16;
  bool is_signed = false;
  bool irreversible = false;  ///< The 9-7 wavelet, compressed to a fifth of the size.
  int tile = 0;               ///< Edge length of a tile; 0: one tile.
  int layers = 1;             ///< Quality layers, which together are lossless.
};

/// Compresses an image. Terminates the program if OpenJPEG fails.
/// @param values  rows x columns
std::vector<std::uint8_t> pack_jpeg2000(int rows, int columns, std::span<const std::int32_t> values,
                                        const Jpeg2000Coding& coding);

}  // namespace palpate::test
