#pragma once

#include <cstdint>
#include <span>
#include <vector>

/// Codestreams of JPEG 2000 packed by OpenJPEG, for tests of whoever unpacks them. No types of OpenJPEG here.
namespace palpate::test {

struct Jpeg2000Coding {
  int bits = 16;
  bool is_signed = false;
  bool irreversible = false;  ///< by the wavelet 9-7, to a fifth of the size
  int tile = 0;               ///< edge of a tile; 0: one tile
  int layers = 1;             ///< that add up to all
};

/// @param values  rows x columns
/// Stops the program where OpenJPEG cannot.
std::vector<std::uint8_t> pack_jpeg2000(int rows, int columns, std::span<const std::int32_t> values,
                                        const Jpeg2000Coding& coding);

}  // namespace palpate::test
